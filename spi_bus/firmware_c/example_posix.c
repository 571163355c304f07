/* One side of the link over a terminal device of a POSIX system: how the calls fit together.
 *
 *     cc -std=c99 -o example_posix example_posix.c fishbed_link.c fishbed_frame.c
 *     ./example_posix DEVICE slave EPOCH           answers until the line is hung up
 *     ./example_posix DEVICE master EPOCH COUNT    sends COUNT pings, waits for their answers
 *
 * As slave it answers a Ping with a Pong and a TailBeat with a CommandApplied. It prints its
 * counters at the end; the exit code is 0 where all answers came, in order and once.
 */
#define _DEFAULT_SOURCE
#define _POSIX_C_SOURCE 200809L
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#include "fishbed_link.h"
#include "fishbed_messages.h"

#define GIVE_UP_US UINT32_C(60000000) /* without any message */

typedef struct {
    fishbed_link link;
    uint8_t replies[64][FISHBED_LARGEST_MESSAGE]; /* until the link takes them */
    uint8_t reply_lengths[64];
    unsigned reply_count;
    unsigned long pongs;
    unsigned long wrong;
    uint32_t last_message_us;
} program;

static uint32_t now_us(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint32_t)((uint64_t)now.tv_sec * 1000000u + (uint64_t)now.tv_nsec / 1000u);
}

static void on_event(void *context, const fishbed_event *event)
{
    program *self = context;
    fishbed_ping ping;
    fishbed_pong pong;
    fishbed_tail_beat beat;
    uint8_t *reply = self->replies[self->reply_count];

    if (event->kind != FISHBED_EVENT_MESSAGE) {
        return;
    }
    self->last_message_us = now_us();
    if (fishbed_decode_pong(&pong, event->payload, event->length)) {
        if (pong.token != (uint16_t)self->pongs) {
            self->wrong++;
        }
        self->pongs++;
    } else if (self->reply_count == 64) {
        self->wrong++; /* cannot be: the receive window is closed before */
    } else if (fishbed_decode_ping(&ping, event->payload, event->length)) {
        pong.token = ping.token;
        self->reply_lengths[self->reply_count++] = fishbed_encode_pong(&pong, reply);
    } else if (fishbed_decode_tail_beat(&beat, event->payload, event->length)) {
        fishbed_command_applied applied;

        applied.command_id = beat.command_id;
        applied.time_us = now_us();
        self->reply_lengths[self->reply_count++] = fishbed_encode_command_applied(&applied, reply);
    }
}

static void send_replies(program *self)
{
    unsigned sent = 0;

    while (sent < self->reply_count &&
           fishbed_send(&self->link, self->replies[sent], self->reply_lengths[sent])) {
        sent++;
    }
    self->reply_count -= sent;
    memmove(self->replies[0], self->replies[sent], self->reply_count * sizeof self->replies[0]);
    memmove(self->reply_lengths, self->reply_lengths + sent, self->reply_count);
    fishbed_set_receive_window(&self->link, self->reply_count ? 0 : self->link.config.window);
}

static int open_raw(const char *device)
{
    struct termios settings;
    int port = open(device, O_RDWR | O_NOCTTY);

    if (port >= 0 && tcgetattr(port, &settings) == 0) {
        cfmakeraw(&settings);
        tcsetattr(port, TCSANOW, &settings);
    }
    return port;
}

static int wait_ms(const fishbed_link *link)
{
    uint32_t deadline_us;
    uint32_t left_us;

    if (!fishbed_next_deadline(link, &deadline_us)) {
        return 100;
    }
    left_us = deadline_us - now_us();
    if (left_us >= UINT32_C(0x80000000)) {
        return 0; /* overdue */
    }
    return left_us > 100000u ? 100 : (int)(left_us / 1000u + 1u);
}

int main(int argc, char **argv)
{
    static program self;
    static const fishbed_config CONFIG = {4, 2000, 20000, 200000};
    fishbed_role role;
    unsigned long count;
    unsigned long asked = 0;
    uint32_t deadline_us;
    struct pollfd line;

    if (argc < 4) {
        fprintf(stderr, "usage: %s DEVICE master|slave EPOCH [COUNT]\n", argv[0]);
        return 2;
    }
    role = strcmp(argv[2], "master") == 0 ? FISHBED_MASTER : FISHBED_SLAVE;
    count = argc > 4 ? strtoul(argv[4], 0, 10) : 0;
    line.fd = open_raw(argv[1]);
    line.events = POLLIN;
    if (line.fd < 0 || !fishbed_init(&self.link, role, (uint16_t)atoi(argv[3]), &CONFIG, on_event,
                                     &self, role == FISHBED_MASTER ? fishbed_from_slave
                                                                   : fishbed_from_master)) {
        perror(argv[1]);
        return 2;
    }
    self.last_message_us = now_us();
    while (role == FISHBED_SLAVE || self.pongs < count || fishbed_wants_to_send(&self.link) ||
           fishbed_next_deadline(&self.link, &deadline_us)) {
        uint8_t bytes[256];
        ssize_t length;

        for (; role == FISHBED_MASTER && asked < count; asked++) {
            fishbed_ping ping;

            ping.token = (uint16_t)asked;
            if (!fishbed_send(&self.link, bytes, fishbed_encode_ping(&ping, bytes))) {
                break;
            }
        }
        send_replies(&self);
        fishbed_handle_timer(&self.link, now_us());
        length = fishbed_data_to_send(&self.link, bytes, sizeof bytes, now_us(), 0);
        if (length > 0 && write(line.fd, bytes, (size_t)length) != length) {
            break;
        }
        if (now_us() - self.last_message_us > GIVE_UP_US) {
            break;
        }
        if (poll(&line, 1, fishbed_wants_to_send(&self.link) ? 0 : wait_ms(&self.link)) <= 0) {
            continue;
        }
        length = read(line.fd, bytes, sizeof bytes);
        if (length <= 0) {
            break; /* hung up */
        }
        fishbed_receive(&self.link, bytes, (uint16_t)length, now_us());
    }
    printf("received %u acknowledged %u again %u duplicates %u crc %u wrong %lu\n",
           (unsigned)self.link.statistics.messages_received,
           (unsigned)self.link.statistics.messages_acknowledged,
           (unsigned)self.link.statistics.retransmissions,
           (unsigned)self.link.statistics.duplicates,
           (unsigned)self.link.statistics.errors[FISHBED_ERROR_CRC], self.wrong);
    return self.wrong || (role == FISHBED_MASTER && self.pongs != count);
}
