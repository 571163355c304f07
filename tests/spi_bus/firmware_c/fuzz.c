/* A slave that lives from standard input: for the sanitizers, with every buffer of exact size.
 *
 * Input, repeated: now_us (4 bytes), receive window (1), length (2), that many received bytes.
 * Output for each: length (2), what the link then sends. Pings are answered with Pongs. Everything
 * received is also thrown at every decoder and at fishbed_open by itself.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fishbed_link.h"
#include "fishbed_messages.h"

static uint16_t tokens[64];
static unsigned token_count;

static void on_event(void *context, const fishbed_event *event)
{
    fishbed_ping ping;

    (void)context;
    if (event->kind == FISHBED_EVENT_MESSAGE) {
        uint8_t *exact = malloc(event->length ? event->length : 1);

        memcpy(exact, event->payload, event->length);
        if (fishbed_decode_ping(&ping, exact, event->length) && token_count < 64) {
            tokens[token_count++] = ping.token;
        }
        free(exact);
    }
}

static void decode_alone(const uint8_t *data, uint16_t length)
{
    uint8_t part = (uint8_t)(length > 255 ? 255 : length);
    uint8_t *exact = malloc(part ? part : 1u);
    fishbed_error error;

    memcpy(exact, data, part);
    (void)fishbed_from_master(exact, part);
    (void)fishbed_from_slave(exact, part);
    (void)fishbed_open(exact, part, &error);
    free(exact);
}

int main(void)
{
    static fishbed_link link;
    static const fishbed_config CONFIG = {4, 5000, 20000, 160000};
    uint8_t head[7];

    if (!fishbed_init(&link, FISHBED_SLAVE, 2, &CONFIG, on_event, 0, fishbed_from_master)) {
        return 2;
    }
    while (fread(head, 1, sizeof head, stdin) == sizeof head) {
        uint32_t now_us = fishbed_get_u32(head);
        uint16_t length = fishbed_get_u16(head + 5);
        uint8_t *data = malloc(length ? length : 1u);
        uint8_t out[600];
        uint8_t size[2];
        uint16_t sent;
        unsigned i;

        if (fread(data, 1, length, stdin) != length) {
            return 3;
        }
        decode_alone(data, length);
        fishbed_set_receive_window(&link, head[4]);
        fishbed_receive(&link, data, length, now_us);
        free(data);
        for (i = 0; i < token_count; i++) {
            fishbed_pong pong;
            uint8_t payload[FISHBED_PONG_BYTES];

            pong.token = tokens[i];
            (void)fishbed_send(&link, payload, fishbed_encode_pong(&pong, payload));
        }
        token_count = 0;
        fishbed_handle_timer(&link, now_us);
        sent = fishbed_data_to_send(&link, out, sizeof out, now_us, 0);
        fishbed_put_u16(size, sent);
        fwrite(size, 1, 2, stdout);
        fwrite(out, 1, sent, stdout);
    }
    return 0;
}
