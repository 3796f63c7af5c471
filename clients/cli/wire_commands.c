/* skinctl call: the wire as it is.
 *
 * Thread: one.
 */
#include "clients/cli/cli.h"
#include "clients/cli/print.h"
#include "clients/cli/values.h"

#include <string.h>

static int run_call(const char *const *arguments, int count, struct skd_error *error)
{
    struct skd_link link;
    struct skd_message answer;
    cJSON *params = NULL;
    if (count > 1 && skd_value_json("the parameters", arguments[1], strlen(arguments[1]), &params,
                                    error) != SKD_OK)
        return SKD_EXIT_USAGE;
    if (params != NULL && !cJSON_IsObject(params)) {
        cJSON_Delete(params);
        return skd_cli_usage(error, "the parameters are a JSON object: '{\"session\": \"rig\"}'");
    }
    if (skd_cli_connect(&link, error) != SKD_OK) {
        cJSON_Delete(params);
        return SKD_EXIT_FAILED;
    }
    enum skd_status status = skd_link_call(&link, arguments[0], params, NULL, 0, &answer, error);
    if (status == SKD_OK)
        skd_print_json(&answer, answer.result);
    skd_message_finish(&answer);
    skd_link_close(&link);
    return skd_cli_exit(status);
}

const struct skd_command skd_command_call = {
    .group = SKD_GROUP_WIRE,
    .name = "call",
    .arguments = "METHOD [PARAMS]",
    .least = 1,
    .most = 2,
    .summary = "send any request and print its result as JSON",
    .details = "PARAMS is a JSON object. protocol/PROTOCOL.md lists the methods.\n",
    .examples = "  skinctl call session.list\n"
                "  skinctl call session.close '{\"session\": \"knight\"}'\n"
                "  skinctl call weights.get '{\"session\": \"knight\", \"vertices\": [0, 1]}'\n",
    .run = run_call,
};
