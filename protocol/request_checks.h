/* Checks that tie several parameters of a request together, after each was read by its row.
 *
 * Stage: request. Thread: any. Private to the protocol library: request.c calls them by its table
 * of methods. Each fills in what a method has no member for, and fails with one sentence
 * (SKD_BAD_PARAMS, SKD_COUNT_MISMATCH, SKD_UNSUPPORTED).
 */
#ifndef SKD_PROTOCOL_REQUEST_CHECKS_H
#define SKD_PROTOCOL_REQUEST_CHECKS_H

#include "protocol/request.h"

/* The words' numbers that the tables and the checks name. */
enum { SKD_WORD_SET, SKD_WORD_MOVE, SKD_WORD_NONE };
enum { SKD_WORD_KEEP, SKD_WORD_EVIDENCE };
enum { SKD_WORD_REPORT };

SKD_MUST_CHECK enum skd_status skd_check_hello(struct skd_request *request,
                                               struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_check_session_create(struct skd_request *request,
                                                        struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_check_session_save(struct skd_request *request,
                                                      struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_check_session_open(struct skd_request *request,
                                                      struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_check_session_verify(struct skd_request *request,
                                                        struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_check_pose_set(struct skd_request *request,
                                                  struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_check_stroke(struct skd_request *request,
                                                struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_check_pins_solve(struct skd_request *request,
                                                    struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_check_refit(struct skd_request *request,
                                               struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_check_weights_set(struct skd_request *request,
                                                     struct skd_error *error);
SKD_MUST_CHECK enum skd_status skd_check_weights_reduce(struct skd_request *request,
                                                        struct skd_error *error);

#endif
