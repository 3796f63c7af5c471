#!/usr/bin/env bash
# The demo: a character, a daemon of its own, an example script of strokes, a file at the end.
# usage: demo.sh BIN [FILE.glb|FILE.gltf] [--json]     BIN: the folder with skind and skinctl
set -euo pipefail

bin=$(realpath "$1")
shift
file='' json=()
for argument in "$@"; do
    case $argument in
    --json) json=(--json) ;;
    -*)
        echo "demo: there is no option $argument; usage: ./run demo [FILE.glb] [--json]" >&2
        exit 2
        ;;
    *) file=$argument ;;
    esac
done

out=$PWD/out/demo
mkdir -p "$out"
# A socket and a state folder of the demo's own: it never touches what the user works with.
runtime=$(mktemp -d)
export SKIND_SOCKET=$runtime/demo.sock SKIND_STATE=$runtime/state
cleanup() {
    "$bin/skinctl" --quiet stop >/dev/null 2>&1 || true
    rm -rf "$runtime"
}
trap cleanup EXIT

if [[ -z $file ]]; then
    file=$out/humanoid.glb
    "$bin/skinctl" generate --vertices 20000 --bones 53 "$file" >&2
fi
[[ -f $file ]] || { echo "demo: there is no file $file" >&2; exit 1; }

"$bin/skinctl" start >&2
# Four influences where the character has no more; else eight, and only then a cut.
for choice in '--influences 4' '--influences 8' '--influences 8 --reduce largest'; do
    read -ra options <<<"$choice"
    if talk=$("$bin/skinctl" load "$file" --name demo "${options[@]}" 2>&1); then
        break
    fi
    [[ $talk == *influences* ]] || { echo "$talk" >&2; exit 1; }
    echo "$talk" >&2
done
echo "$talk" >&2

stem=$(basename "$file")
"$bin/skinctl" script >"$out/strokes.yaml"
"$bin/skinctl" replay "$out/strokes.yaml" --export "$out/${stem%.*}-skind.${stem##*.}" "${json[@]}"
