# One set of flags for all of our code. Contraction of a*b+c into one instruction is off
# everywhere: the same strokes give the same bits on every instruction set.
add_compile_options(-ffp-contract=off -fno-math-errno -fno-trapping-math)
add_compile_options(-Wall -Wextra -Wpedantic -Wshadow -Wvla -Wundef -Wformat=2)
add_compile_options(
  $<$<COMPILE_LANGUAGE:C>:-Wconversion>
  $<$<COMPILE_LANGUAGE:C>:-Wmissing-prototypes>
  $<$<COMPILE_LANGUAGE:C>:-Wstrict-prototypes>)
add_compile_definitions(_GNU_SOURCE)
if(SKD_WERROR)
  add_compile_options(-Werror)
endif()
if(SKD_SANITIZE)
  add_compile_options(-fsanitize=${SKD_SANITIZE} -fno-omit-frame-pointer -fno-sanitize-recover=all)
  add_link_options(-fsanitize=${SKD_SANITIZE})
endif()
include_directories(${CMAKE_SOURCE_DIR} ${CMAKE_SOURCE_DIR}/server)
