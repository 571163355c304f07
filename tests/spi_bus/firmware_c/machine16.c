/* Two links talk through a bad wire; eight numbers say how it went. For a machine with 16-bit ints.
 *
 * The same program runs on the host and in a simulated MSP430, and must come to the same numbers; the
 * second is a digest of every byte that was said. The time wraps on the way.
 */
#include "fishbed_link.h"
#include "fishbed_messages.h"

#define TURNS 600u
#define COMMANDS 60u

static fishbed_link links[2];
static uint16_t answers;
static uint16_t commands;
volatile uint16_t result[8];
void run(void);

static uint64_t time_of(uint16_t number)
{
    return (uint64_t)number << 30 | (number ^ 0x55u);
}

static void on_event(void *context, const fishbed_event *event)
{
    fishbed_tail_beat beat;
    fishbed_sensor_report report = {0};
    uint8_t payload[FISHBED_SENSOR_REPORT_BYTES];

    (void)context;
    if (event->kind != FISHBED_EVENT_MESSAGE) {
        return;
    }
    if (fishbed_decode_tail_beat(&beat, event->payload, event->length)) {
        commands++;
        report.valid = 0x7FF;
        report.time_us = time_of(beat.command_id);
        report.sequence = beat.command_id;
        report.gyro_z_rad_s_raw = beat.bias_rad_raw;
        report.heading_rad_raw = -32767 - 1;
        report.battery_v_raw = 65535u;
        fishbed_send(&links[1], payload, fishbed_encode_sensor_report(&report, payload));
    } else if (fishbed_decode_sensor_report(&report, event->payload, event->length) &&
               report.time_us == time_of(report.sequence) &&
               report.heading_rad_raw == -32767 - 1 && report.battery_v_raw == 65535u &&
               report.gyro_z_rad_s_raw == (int16_t)((int16_t)report.sequence * 100 - 3000)) {
        answers++;
    }
}

void run(void)
{
    uint32_t now = UINT32_C(0xFFFF0000);
    uint16_t digest = 0xFFFFu;
    uint16_t number = 0;
    uint16_t turn;

    answers = commands = 0;
    fishbed_init(&links[0], FISHBED_MASTER, 0x0101, 0, on_event, 0, fishbed_from_slave);
    fishbed_init(&links[1], FISHBED_SLAVE, 0x0202, 0, on_event, 0, fishbed_from_master);
    for (turn = 0; turn < TURNS; turn++, now += 5000u) {
        uint8_t i;
        fishbed_tail_beat beat = {0, 0, 5000, 900, 500};
        uint8_t payload[FISHBED_TAIL_BEAT_BYTES];

        beat.command_id = number;
        beat.bias_rad_raw = (int16_t)((int16_t)number * 100 - 3000);
        if (number < COMMANDS &&
            fishbed_send(&links[0], payload, fishbed_encode_tail_beat(&beat, payload))) {
            number++;
        }
        for (i = 0; i < 2; i++) {
            uint8_t bytes[50];
            uint16_t count;
            uint16_t k;

            fishbed_handle_timer(&links[i], now);
            count = fishbed_data_to_send(&links[i], bytes, sizeof bytes, now, 0);
            for (k = 0; k < count; k++) {
                digest = (uint16_t)(((digest << 1) | (digest >> 15)) ^ bytes[k]);
            }
            if (turn % 11 == 7 && count) {
                bytes[turn % count] ^= 0x10;
            }
            if (turn % 13 != 5) {
                fishbed_receive(&links[1 - i], bytes, count, now);
            }
        }
    }
    result[0] = 0x600D;
    result[1] = digest;
    result[2] = commands;
    result[3] = answers;
    result[4] = links[0].statistics.retransmissions;
    result[5] = links[1].statistics.retransmissions;
    result[6] = links[1].statistics.errors[FISHBED_ERROR_CRC];
    result[7] = fishbed_crc16((const uint8_t *)"123456789", 9);
}

#ifdef HOST
#include <stdio.h>

int main(void)
{
    int i;

    run();
    for (i = 0; i < 8; i++) {
        printf("%04x ", (unsigned)result[i]);
    }
    return 0;
}
#else
/* What the compiler calls and no library is there to offer. */

void *memcpy(void *to, const void *from, unsigned count);
void *memset(void *to, int value, unsigned count);
int __mspabi_mpyi(int a, int b);
unsigned __mspabi_remu(unsigned a, unsigned b);

void *memcpy(void *to, const void *from, unsigned count)
{
    char *target = to;
    const char *source = from;

    while (count--) {
        *target++ = *source++;
    }
    return to;
}

void *memset(void *to, int value, unsigned count)
{
    char *target = to;

    while (count--) {
        *target++ = (char)value;
    }
    return to;
}

int __mspabi_mpyi(int a, int b)
{
    unsigned product = 0, x = (unsigned)a, y = (unsigned)b;

    for (; y; y >>= 1, x <<= 1) {
        product += y & 1 ? x : 0;
    }
    return (int)product;
}

unsigned __mspabi_remu(unsigned a, unsigned b)
{
    while (a >= b) {
        a -= b;
    }
    return a;
}
#endif
