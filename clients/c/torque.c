/* Prints the patient's torque at the right hip, by zenoh-pico. Arguments: endpoint, and then TRAINER
 * of the keys if it is not `trainer`. The payload is JSON: a display of your own uses a JSON library;
 * this one looks up one number, and takes null for what it is: not known. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <zenoh-pico.h>

static void print_torque(z_loaned_sample_t *sample, void *context) {
    (void)context;
    z_owned_string_t payload;
    if (z_bytes_to_string(z_sample_payload(sample), &payload) < 0) return;
    size_t length = z_string_len(z_loan(payload));
    char *text = malloc(length + 1);
    if (text != NULL) {
        memcpy(text, z_string_data(z_loan(payload)), length);
        text[length] = '\0';
        char *hip = strstr(text, "\"hip\":{");
        char *patient = hip == NULL ? NULL : strstr(hip, "\"patient\":");
        char *end = NULL;
        double torque_nm = patient == NULL ? 0.0 : strtod(patient + strlen("\"patient\":"), &end);
        if (patient == NULL || end == patient + strlen("\"patient\":"))
            puts("unknown");
        else
            printf("%.1f N·m\n", torque_nm);
        fflush(stdout);
        free(text);
    }
    z_drop(z_move(payload));
}

int main(int count, char **arguments) {
    const char *endpoint = count > 1 ? arguments[1] : "tcp/127.0.0.1:7447";
    char key[128];
    snprintf(key, sizeof key, "gaitd/%s/right/activity", count > 2 ? arguments[2] : "trainer");

    z_owned_config_t config;
    z_config_default(&config);
    zp_config_insert(z_loan_mut(config), Z_CONFIG_MODE_KEY, "client");
    zp_config_insert(z_loan_mut(config), Z_CONFIG_CONNECT_KEY, endpoint);
    z_owned_session_t session;
    if (z_open(&session, z_move(config), NULL) < 0) {
        fprintf(stderr, "no service at %s\n", endpoint);
        return 1;
    }
    z_owned_closure_sample_t callback;
    z_closure(&callback, print_torque, NULL, NULL);
    z_view_keyexpr_t expression;
    z_owned_subscriber_t subscriber;
    if (z_view_keyexpr_from_str(&expression, key) < 0 ||
        z_declare_subscriber(z_loan(session), &subscriber, z_loan(expression), z_move(callback), NULL) < 0) {
        fprintf(stderr, "cannot subscribe to %s\n", key);
        return 1;
    }
    for (;;) sleep(1);
}
