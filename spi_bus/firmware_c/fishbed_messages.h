/* Messages with their layouts. Made by python -m tools.message_reference from the table in
 * spi_bus/messages.py: change that and not this file. docs/messages.md has them in words.
 *
 * Members that end in _raw hold scaled integers: value = raw / ..._LSB_PER_UNIT. A message with
 * optional members has `valid`, a mask of ..._HAS_... bits; a member without its bit is no value.
 *
 * Encoders write number and fields, the payload of fishbed_send, and return its length; 0 where a
 * member is outside its range, and then the buffer is untouched. Decoders return 1; 0 where the
 * payload is not this message as an encoder makes it, and then the struct is undefined.
 */
#ifndef FISHBED_MESSAGES_H
#define FISHBED_MESSAGES_H

#include "fishbed_bytes.h"

#include <stdint.h>

/* Longest payload of the table; FISHBED_MAX_PAYLOAD of fishbed_link.h must hold it. */
#define FISHBED_LARGEST_MESSAGE 33

/* TailBeat, from the master: tail-beat command. */
#define FISHBED_TAIL_BEAT_ID 0x01
#define FISHBED_TAIL_BEAT_BYTES 11
#define FISHBED_TAIL_BEAT_BIAS_RAD_LSB_PER_UNIT 20000
#define FISHBED_TAIL_BEAT_BIAS_RAD_MIN (-32000)
#define FISHBED_TAIL_BEAT_BIAS_RAD_MAX 32000
#define FISHBED_TAIL_BEAT_AMPLITUDE_RAD_LSB_PER_UNIT 20000
#define FISHBED_TAIL_BEAT_AMPLITUDE_RAD_MIN 0
#define FISHBED_TAIL_BEAT_AMPLITUDE_RAD_MAX 32000
#define FISHBED_TAIL_BEAT_FREQUENCY_HZ_LSB_PER_UNIT 1000
#define FISHBED_TAIL_BEAT_FREQUENCY_HZ_MIN 0
#define FISHBED_TAIL_BEAT_FREQUENCY_HZ_MAX 20000
#define FISHBED_TAIL_BEAT_VALID_FOR_S_LSB_PER_UNIT 100

typedef struct {
    uint16_t command_id; /* chosen by the sender, to tell commands apart */
    int16_t bias_rad_raw; /* rad; mean tail angle */
    int16_t amplitude_rad_raw; /* rad; half the tail's swing */
    uint16_t frequency_hz_raw; /* Hz; tail beats per second */
    uint16_t valid_for_s_raw; /* s; after this the fail-safe takes over */
} fishbed_tail_beat;

static inline uint8_t fishbed_encode_tail_beat(const fishbed_tail_beat *message, uint8_t *payload)
{
    if (message->bias_rad_raw < FISHBED_TAIL_BEAT_BIAS_RAD_MIN || message->bias_rad_raw >
            FISHBED_TAIL_BEAT_BIAS_RAD_MAX || message->amplitude_rad_raw <
            FISHBED_TAIL_BEAT_AMPLITUDE_RAD_MIN || message->amplitude_rad_raw >
            FISHBED_TAIL_BEAT_AMPLITUDE_RAD_MAX || message->frequency_hz_raw >
            FISHBED_TAIL_BEAT_FREQUENCY_HZ_MAX) {
        return 0;
    }
    payload[0] = FISHBED_TAIL_BEAT_ID;
    fishbed_put_u16(payload + 1, message->command_id);
    fishbed_put_u16(payload + 3, (uint16_t)(message->bias_rad_raw));
    fishbed_put_u16(payload + 5, (uint16_t)(message->amplitude_rad_raw));
    fishbed_put_u16(payload + 7, message->frequency_hz_raw);
    fishbed_put_u16(payload + 9, message->valid_for_s_raw);
    return FISHBED_TAIL_BEAT_BYTES;
}

static inline uint8_t fishbed_decode_tail_beat(fishbed_tail_beat *message, const uint8_t *payload,
                                               uint8_t length)
{
    if (length != FISHBED_TAIL_BEAT_BYTES || payload[0] != FISHBED_TAIL_BEAT_ID) {
        return 0;
    }
    message->command_id = fishbed_get_u16(payload + 1);
    message->bias_rad_raw = fishbed_signed_16(fishbed_get_u16(payload + 3));
    message->amplitude_rad_raw = fishbed_signed_16(fishbed_get_u16(payload + 5));
    message->frequency_hz_raw = fishbed_get_u16(payload + 7);
    message->valid_for_s_raw = fishbed_get_u16(payload + 9);
    if (message->bias_rad_raw < FISHBED_TAIL_BEAT_BIAS_RAD_MIN || message->bias_rad_raw >
            FISHBED_TAIL_BEAT_BIAS_RAD_MAX || message->amplitude_rad_raw <
            FISHBED_TAIL_BEAT_AMPLITUDE_RAD_MIN || message->amplitude_rad_raw >
            FISHBED_TAIL_BEAT_AMPLITUDE_RAD_MAX || message->frequency_hz_raw >
            FISHBED_TAIL_BEAT_FREQUENCY_HZ_MAX) {
        return 0;
    }
    return 1;
}

/* SetReporting, from the master: what is reported how often. */
#define FISHBED_SET_REPORTING_ID 0x02
#define FISHBED_SET_REPORTING_BYTES 4
#define FISHBED_SET_REPORTING_PERIOD_S_LSB_PER_UNIT 1000
#define FISHBED_SET_REPORTING_GPS_ENABLED_MIN 0
#define FISHBED_SET_REPORTING_GPS_ENABLED_MAX 1

typedef struct {
    uint16_t period_s_raw; /* s; between sensor reports; 0 stops them */
    uint8_t gps_enabled; /* forward GPS fixes */
} fishbed_set_reporting;

static inline uint8_t fishbed_encode_set_reporting(const fishbed_set_reporting *message,
                                                   uint8_t *payload)
{
    if (message->gps_enabled > FISHBED_SET_REPORTING_GPS_ENABLED_MAX) {
        return 0;
    }
    payload[0] = FISHBED_SET_REPORTING_ID;
    fishbed_put_u16(payload + 1, message->period_s_raw);
    payload[3] = message->gps_enabled;
    return FISHBED_SET_REPORTING_BYTES;
}

static inline uint8_t fishbed_decode_set_reporting(fishbed_set_reporting *message,
                                                   const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_SET_REPORTING_BYTES || payload[0] != FISHBED_SET_REPORTING_ID) {
        return 0;
    }
    message->period_s_raw = fishbed_get_u16(payload + 1);
    message->gps_enabled = payload[3];
    if (message->gps_enabled > FISHBED_SET_REPORTING_GPS_ENABLED_MAX) {
        return 0;
    }
    return 1;
}

/* Ping, from the master: round-trip probe. */
#define FISHBED_PING_ID 0x03
#define FISHBED_PING_BYTES 3

typedef struct {
    uint16_t token; /* comes back in the Pong */
} fishbed_ping;

static inline uint8_t fishbed_encode_ping(const fishbed_ping *message, uint8_t *payload)
{
    payload[0] = FISHBED_PING_ID;
    fishbed_put_u16(payload + 1, message->token);
    return FISHBED_PING_BYTES;
}

static inline uint8_t fishbed_decode_ping(fishbed_ping *message, const uint8_t *payload,
                                          uint8_t length)
{
    if (length != FISHBED_PING_BYTES || payload[0] != FISHBED_PING_ID) {
        return 0;
    }
    message->token = fishbed_get_u16(payload + 1);
    return 1;
}

/* ClockReport, from the master: the processing board's clock. */
#define FISHBED_CLOCK_REPORT_ID 0x04
#define FISHBED_CLOCK_REPORT_BYTES 9

typedef struct {
    uint16_t token; /* of the ClockRequest */
    uint64_t time_us; /* µs; since reset; wraps after 8.9 years */
} fishbed_clock_report;

static inline uint8_t fishbed_encode_clock_report(const fishbed_clock_report *message,
                                                  uint8_t *payload)
{
    if (message->time_us > UINT64_C(281474976710655)) {
        return 0;
    }
    payload[0] = FISHBED_CLOCK_REPORT_ID;
    fishbed_put_u16(payload + 1, message->token);
    fishbed_put(payload + 3, message->time_us, 6);
    return FISHBED_CLOCK_REPORT_BYTES;
}

static inline uint8_t fishbed_decode_clock_report(fishbed_clock_report *message,
                                                  const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_CLOCK_REPORT_BYTES || payload[0] != FISHBED_CLOCK_REPORT_ID) {
        return 0;
    }
    message->token = fishbed_get_u16(payload + 1);
    message->time_us = fishbed_get(payload + 3, 6);
    if (message->time_us > UINT64_C(281474976710655)) {
        return 0;
    }
    return 1;
}

/* SensorReport, from the slave: all instruments once. */
#define FISHBED_SENSOR_REPORT_ID 0x81
#define FISHBED_SENSOR_REPORT_BYTES 33
#define FISHBED_SENSOR_REPORT_GYRO_Z_RAD_S_LSB_PER_UNIT 2000
#define FISHBED_SENSOR_REPORT_HAS_GYRO_Z_RAD_S 0x0001u
#define FISHBED_SENSOR_REPORT_ACCEL_X_M_S2_LSB_PER_UNIT 200
#define FISHBED_SENSOR_REPORT_HAS_ACCEL_X_M_S2 0x0002u
#define FISHBED_SENSOR_REPORT_ACCEL_Y_M_S2_LSB_PER_UNIT 200
#define FISHBED_SENSOR_REPORT_HAS_ACCEL_Y_M_S2 0x0004u
#define FISHBED_SENSOR_REPORT_ACCEL_Z_M_S2_LSB_PER_UNIT 200
#define FISHBED_SENSOR_REPORT_HAS_ACCEL_Z_M_S2 0x0008u
#define FISHBED_SENSOR_REPORT_COMPASS_RAD_LSB_PER_UNIT 10430.378350470453
#define FISHBED_SENSOR_REPORT_HAS_COMPASS_RAD 0x0010u
#define FISHBED_SENSOR_REPORT_HEADING_RAD_LSB_PER_UNIT 10430.378350470453
#define FISHBED_SENSOR_REPORT_HAS_HEADING_RAD 0x0020u
#define FISHBED_SENSOR_REPORT_TAIL_COMMAND_RAD_LSB_PER_UNIT 10000
#define FISHBED_SENSOR_REPORT_HAS_TAIL_COMMAND_RAD 0x0040u
#define FISHBED_SENSOR_REPORT_BATTERY_V_LSB_PER_UNIT 1000
#define FISHBED_SENSOR_REPORT_HAS_BATTERY_V 0x0080u
#define FISHBED_SENSOR_REPORT_SERVO_CURRENT_A_LSB_PER_UNIT 1000
#define FISHBED_SENSOR_REPORT_HAS_SERVO_CURRENT_A 0x0100u
#define FISHBED_SENSOR_REPORT_TEMPERATURE_C_LSB_PER_UNIT 100
#define FISHBED_SENSOR_REPORT_HAS_TEMPERATURE_C 0x0200u
#define FISHBED_SENSOR_REPORT_WATER_QUALITY_UG_L_LSB_PER_UNIT 10
#define FISHBED_SENSOR_REPORT_HAS_WATER_QUALITY_UG_L 0x0400u

typedef struct {
    uint16_t valid;
    uint64_t time_us; /* µs; since reset; wraps after 8.9 years */
    uint16_t sequence; /* counts reports, wraps */
    int16_t gyro_z_rad_s_raw; /* rad/s; yaw rate, ±16.4 */
    int16_t accel_x_m_s2_raw; /* m/s²; body axis x */
    int16_t accel_y_m_s2_raw; /* m/s²; body axis y */
    int16_t accel_z_m_s2_raw; /* m/s²; body axis z */
    int16_t compass_rad_raw; /* rad; magnetic heading, counter-clockwise from the tank's +x */
    int16_t heading_rad_raw; /* rad; filtered heading, same sense */
    int16_t tail_command_rad_raw; /* rad; α(t) now */
    uint16_t battery_v_raw; /* V; pack voltage */
    int16_t servo_current_a_raw; /* A; servo supply */
    int16_t temperature_c_raw; /* °C; water temperature */
    uint16_t water_quality_ug_l_raw; /* µg/L; oil or chlorophyll */
} fishbed_sensor_report;

static inline uint8_t fishbed_encode_sensor_report(const fishbed_sensor_report *message,
                                                   uint8_t *payload)
{
    if (message->valid > 2047 || message->time_us > UINT64_C(281474976710655)) {
        return 0;
    }
    payload[0] = FISHBED_SENSOR_REPORT_ID;
    fishbed_put_u16(payload + 1, message->valid);
    fishbed_put(payload + 3, message->time_us, 6);
    fishbed_put_u16(payload + 9, message->sequence);
    fishbed_put_u16(payload + 11, (uint16_t)(message->valid & FISHBED_SENSOR_REPORT_HAS_GYRO_Z_RAD_S
            ? message->gyro_z_rad_s_raw : 0));
    fishbed_put_u16(payload + 13, (uint16_t)(message->valid & FISHBED_SENSOR_REPORT_HAS_ACCEL_X_M_S2
            ? message->accel_x_m_s2_raw : 0));
    fishbed_put_u16(payload + 15, (uint16_t)(message->valid & FISHBED_SENSOR_REPORT_HAS_ACCEL_Y_M_S2
            ? message->accel_y_m_s2_raw : 0));
    fishbed_put_u16(payload + 17, (uint16_t)(message->valid & FISHBED_SENSOR_REPORT_HAS_ACCEL_Z_M_S2
            ? message->accel_z_m_s2_raw : 0));
    fishbed_put_u16(payload + 19, (uint16_t)(message->valid & FISHBED_SENSOR_REPORT_HAS_COMPASS_RAD
            ? message->compass_rad_raw : 0));
    fishbed_put_u16(payload + 21, (uint16_t)(message->valid & FISHBED_SENSOR_REPORT_HAS_HEADING_RAD
            ? message->heading_rad_raw : 0));
    fishbed_put_u16(payload + 23, (uint16_t)(message->valid &
            FISHBED_SENSOR_REPORT_HAS_TAIL_COMMAND_RAD ? message->tail_command_rad_raw : 0));
    fishbed_put_u16(payload + 25, (uint16_t)(message->valid & FISHBED_SENSOR_REPORT_HAS_BATTERY_V ?
            message->battery_v_raw : 0));
    fishbed_put_u16(payload + 27, (uint16_t)(message->valid &
            FISHBED_SENSOR_REPORT_HAS_SERVO_CURRENT_A ? message->servo_current_a_raw : 0));
    fishbed_put_u16(payload + 29, (uint16_t)(message->valid &
            FISHBED_SENSOR_REPORT_HAS_TEMPERATURE_C ? message->temperature_c_raw : 0));
    fishbed_put_u16(payload + 31, (uint16_t)(message->valid &
            FISHBED_SENSOR_REPORT_HAS_WATER_QUALITY_UG_L ? message->water_quality_ug_l_raw : 0));
    return FISHBED_SENSOR_REPORT_BYTES;
}

static inline uint8_t fishbed_decode_sensor_report(fishbed_sensor_report *message,
                                                   const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_SENSOR_REPORT_BYTES || payload[0] != FISHBED_SENSOR_REPORT_ID) {
        return 0;
    }
    message->valid = fishbed_get_u16(payload + 1);
    message->time_us = fishbed_get(payload + 3, 6);
    message->sequence = fishbed_get_u16(payload + 9);
    message->gyro_z_rad_s_raw = fishbed_signed_16(fishbed_get_u16(payload + 11));
    message->accel_x_m_s2_raw = fishbed_signed_16(fishbed_get_u16(payload + 13));
    message->accel_y_m_s2_raw = fishbed_signed_16(fishbed_get_u16(payload + 15));
    message->accel_z_m_s2_raw = fishbed_signed_16(fishbed_get_u16(payload + 17));
    message->compass_rad_raw = fishbed_signed_16(fishbed_get_u16(payload + 19));
    message->heading_rad_raw = fishbed_signed_16(fishbed_get_u16(payload + 21));
    message->tail_command_rad_raw = fishbed_signed_16(fishbed_get_u16(payload + 23));
    message->battery_v_raw = fishbed_get_u16(payload + 25);
    message->servo_current_a_raw = fishbed_signed_16(fishbed_get_u16(payload + 27));
    message->temperature_c_raw = fishbed_signed_16(fishbed_get_u16(payload + 29));
    message->water_quality_ug_l_raw = fishbed_get_u16(payload + 31);
    if (message->valid > 2047 || message->time_us > UINT64_C(281474976710655) || (!(message->valid &
            FISHBED_SENSOR_REPORT_HAS_GYRO_Z_RAD_S) && message->gyro_z_rad_s_raw != 0) ||
            (!(message->valid & FISHBED_SENSOR_REPORT_HAS_ACCEL_X_M_S2) && message->accel_x_m_s2_raw
            != 0) || (!(message->valid & FISHBED_SENSOR_REPORT_HAS_ACCEL_Y_M_S2) &&
            message->accel_y_m_s2_raw != 0) || (!(message->valid &
            FISHBED_SENSOR_REPORT_HAS_ACCEL_Z_M_S2) && message->accel_z_m_s2_raw != 0) ||
            (!(message->valid & FISHBED_SENSOR_REPORT_HAS_COMPASS_RAD) && message->compass_rad_raw
            != 0) || (!(message->valid & FISHBED_SENSOR_REPORT_HAS_HEADING_RAD) &&
            message->heading_rad_raw != 0) || (!(message->valid &
            FISHBED_SENSOR_REPORT_HAS_TAIL_COMMAND_RAD) && message->tail_command_rad_raw != 0) ||
            (!(message->valid & FISHBED_SENSOR_REPORT_HAS_BATTERY_V) && message->battery_v_raw != 0)
            || (!(message->valid & FISHBED_SENSOR_REPORT_HAS_SERVO_CURRENT_A) &&
            message->servo_current_a_raw != 0) || (!(message->valid &
            FISHBED_SENSOR_REPORT_HAS_TEMPERATURE_C) && message->temperature_c_raw != 0) ||
            (!(message->valid & FISHBED_SENSOR_REPORT_HAS_WATER_QUALITY_UG_L) &&
            message->water_quality_ug_l_raw != 0)) {
        return 0;
    }
    return 1;
}

/* GpsReport, from the slave: a GPS fix. */
#define FISHBED_GPS_REPORT_ID 0x82
#define FISHBED_GPS_REPORT_BYTES 25
#define FISHBED_GPS_REPORT_LATITUDE_DEG_LSB_PER_UNIT 10000000
#define FISHBED_GPS_REPORT_LATITUDE_DEG_MIN (INT32_C(-900000000))
#define FISHBED_GPS_REPORT_LATITUDE_DEG_MAX INT32_C(900000000)
#define FISHBED_GPS_REPORT_HAS_LATITUDE_DEG 0x0001u
#define FISHBED_GPS_REPORT_LONGITUDE_DEG_LSB_PER_UNIT 10000000
#define FISHBED_GPS_REPORT_LONGITUDE_DEG_MIN (INT32_C(-1800000000))
#define FISHBED_GPS_REPORT_LONGITUDE_DEG_MAX INT32_C(1800000000)
#define FISHBED_GPS_REPORT_HAS_LONGITUDE_DEG 0x0002u
#define FISHBED_GPS_REPORT_SPEED_M_S_LSB_PER_UNIT 100
#define FISHBED_GPS_REPORT_HAS_SPEED_M_S 0x0004u
#define FISHBED_GPS_REPORT_COURSE_RAD_LSB_PER_UNIT 10430.378350470453
#define FISHBED_GPS_REPORT_HAS_COURSE_RAD 0x0008u
#define FISHBED_GPS_REPORT_FIX_TIME_S_LSB_PER_UNIT 1000
#define FISHBED_GPS_REPORT_FIX_TIME_S_MIN 0
#define FISHBED_GPS_REPORT_FIX_TIME_S_MAX UINT32_C(86401000)
#define FISHBED_GPS_REPORT_HAS_FIX_TIME_S 0x0010u

typedef struct {
    uint8_t valid;
    uint64_t time_us; /* µs; since reset; wraps after 8.9 years */
    int32_t latitude_deg_raw; /* °; WGS 84 */
    int32_t longitude_deg_raw; /* °; east */
    uint16_t speed_m_s_raw; /* m/s; over ground */
    int16_t course_rad_raw; /* rad; over ground, clockwise from true north */
    uint32_t fix_time_s_raw; /* s; UTC of day */
    uint8_t satellites; /* used in the fix */
} fishbed_gps_report;

static inline uint8_t fishbed_encode_gps_report(const fishbed_gps_report *message,
                                                uint8_t *payload)
{
    if (message->valid > 31 || message->time_us > UINT64_C(281474976710655) || ((message->valid &
            FISHBED_GPS_REPORT_HAS_LATITUDE_DEG) && (message->latitude_deg_raw <
            FISHBED_GPS_REPORT_LATITUDE_DEG_MIN || message->latitude_deg_raw >
            FISHBED_GPS_REPORT_LATITUDE_DEG_MAX)) || ((message->valid &
            FISHBED_GPS_REPORT_HAS_LONGITUDE_DEG) && (message->longitude_deg_raw <
            FISHBED_GPS_REPORT_LONGITUDE_DEG_MIN || message->longitude_deg_raw >
            FISHBED_GPS_REPORT_LONGITUDE_DEG_MAX)) || ((message->valid &
            FISHBED_GPS_REPORT_HAS_FIX_TIME_S) && (message->fix_time_s_raw >
            FISHBED_GPS_REPORT_FIX_TIME_S_MAX))) {
        return 0;
    }
    payload[0] = FISHBED_GPS_REPORT_ID;
    payload[1] = message->valid;
    fishbed_put(payload + 2, message->time_us, 6);
    fishbed_put_u32(payload + 8, (uint32_t)(message->valid & FISHBED_GPS_REPORT_HAS_LATITUDE_DEG ?
            message->latitude_deg_raw : 0));
    fishbed_put_u32(payload + 12, (uint32_t)(message->valid & FISHBED_GPS_REPORT_HAS_LONGITUDE_DEG ?
            message->longitude_deg_raw : 0));
    fishbed_put_u16(payload + 16, (uint16_t)(message->valid & FISHBED_GPS_REPORT_HAS_SPEED_M_S ?
            message->speed_m_s_raw : 0));
    fishbed_put_u16(payload + 18, (uint16_t)(message->valid & FISHBED_GPS_REPORT_HAS_COURSE_RAD ?
            message->course_rad_raw : 0));
    fishbed_put_u32(payload + 20, (uint32_t)(message->valid & FISHBED_GPS_REPORT_HAS_FIX_TIME_S ?
            message->fix_time_s_raw : 0));
    payload[24] = message->satellites;
    return FISHBED_GPS_REPORT_BYTES;
}

static inline uint8_t fishbed_decode_gps_report(fishbed_gps_report *message,
                                                const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_GPS_REPORT_BYTES || payload[0] != FISHBED_GPS_REPORT_ID) {
        return 0;
    }
    message->valid = payload[1];
    message->time_us = fishbed_get(payload + 2, 6);
    message->latitude_deg_raw = fishbed_signed_32(fishbed_get_u32(payload + 8));
    message->longitude_deg_raw = fishbed_signed_32(fishbed_get_u32(payload + 12));
    message->speed_m_s_raw = fishbed_get_u16(payload + 16);
    message->course_rad_raw = fishbed_signed_16(fishbed_get_u16(payload + 18));
    message->fix_time_s_raw = fishbed_get_u32(payload + 20);
    message->satellites = payload[24];
    if (message->valid > 31 || message->time_us > UINT64_C(281474976710655) || ((message->valid &
            FISHBED_GPS_REPORT_HAS_LATITUDE_DEG) && (message->latitude_deg_raw <
            FISHBED_GPS_REPORT_LATITUDE_DEG_MIN || message->latitude_deg_raw >
            FISHBED_GPS_REPORT_LATITUDE_DEG_MAX)) || ((message->valid &
            FISHBED_GPS_REPORT_HAS_LONGITUDE_DEG) && (message->longitude_deg_raw <
            FISHBED_GPS_REPORT_LONGITUDE_DEG_MIN || message->longitude_deg_raw >
            FISHBED_GPS_REPORT_LONGITUDE_DEG_MAX)) || ((message->valid &
            FISHBED_GPS_REPORT_HAS_FIX_TIME_S) && (message->fix_time_s_raw >
            FISHBED_GPS_REPORT_FIX_TIME_S_MAX)) || (!(message->valid &
            FISHBED_GPS_REPORT_HAS_LATITUDE_DEG) && message->latitude_deg_raw != 0) ||
            (!(message->valid & FISHBED_GPS_REPORT_HAS_LONGITUDE_DEG) && message->longitude_deg_raw
            != 0) || (!(message->valid & FISHBED_GPS_REPORT_HAS_SPEED_M_S) && message->speed_m_s_raw
            != 0) || (!(message->valid & FISHBED_GPS_REPORT_HAS_COURSE_RAD) &&
            message->course_rad_raw != 0) || (!(message->valid & FISHBED_GPS_REPORT_HAS_FIX_TIME_S)
            && message->fix_time_s_raw != 0)) {
        return 0;
    }
    return 1;
}

/* CommandApplied, from the slave: a command took effect. */
#define FISHBED_COMMAND_APPLIED_ID 0x83
#define FISHBED_COMMAND_APPLIED_BYTES 9

typedef struct {
    uint16_t command_id; /* chosen by the sender, to tell commands apart */
    uint64_t time_us; /* µs; since reset; wraps after 8.9 years */
} fishbed_command_applied;

static inline uint8_t fishbed_encode_command_applied(const fishbed_command_applied *message,
                                                     uint8_t *payload)
{
    if (message->time_us > UINT64_C(281474976710655)) {
        return 0;
    }
    payload[0] = FISHBED_COMMAND_APPLIED_ID;
    fishbed_put_u16(payload + 1, message->command_id);
    fishbed_put(payload + 3, message->time_us, 6);
    return FISHBED_COMMAND_APPLIED_BYTES;
}

static inline uint8_t fishbed_decode_command_applied(fishbed_command_applied *message,
                                                     const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_COMMAND_APPLIED_BYTES || payload[0] != FISHBED_COMMAND_APPLIED_ID) {
        return 0;
    }
    message->command_id = fishbed_get_u16(payload + 1);
    message->time_us = fishbed_get(payload + 3, 6);
    if (message->time_us > UINT64_C(281474976710655)) {
        return 0;
    }
    return 1;
}

/* BoardEvent, from the slave: resets, fail-safe, overruns. */
#define FISHBED_BOARD_EVENT_ID 0x84
#define FISHBED_BOARD_EVENT_BYTES 10

typedef struct {
    uint64_t time_us; /* µs; since reset; wraps after 8.9 years */
    uint8_t code; /* see BoardEventCode */
    uint16_t detail; /* depends on the code */
} fishbed_board_event;

static inline uint8_t fishbed_encode_board_event(const fishbed_board_event *message,
                                                 uint8_t *payload)
{
    if (message->time_us > UINT64_C(281474976710655)) {
        return 0;
    }
    payload[0] = FISHBED_BOARD_EVENT_ID;
    fishbed_put(payload + 1, message->time_us, 6);
    payload[7] = message->code;
    fishbed_put_u16(payload + 8, message->detail);
    return FISHBED_BOARD_EVENT_BYTES;
}

static inline uint8_t fishbed_decode_board_event(fishbed_board_event *message,
                                                 const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_BOARD_EVENT_BYTES || payload[0] != FISHBED_BOARD_EVENT_ID) {
        return 0;
    }
    message->time_us = fishbed_get(payload + 1, 6);
    message->code = payload[7];
    message->detail = fishbed_get_u16(payload + 8);
    if (message->time_us > UINT64_C(281474976710655)) {
        return 0;
    }
    return 1;
}

/* Pong, from the slave: answer to a Ping. */
#define FISHBED_PONG_ID 0x85
#define FISHBED_PONG_BYTES 3

typedef struct {
    uint16_t token; /* of the Ping */
} fishbed_pong;

static inline uint8_t fishbed_encode_pong(const fishbed_pong *message, uint8_t *payload)
{
    payload[0] = FISHBED_PONG_ID;
    fishbed_put_u16(payload + 1, message->token);
    return FISHBED_PONG_BYTES;
}

static inline uint8_t fishbed_decode_pong(fishbed_pong *message, const uint8_t *payload,
                                          uint8_t length)
{
    if (length != FISHBED_PONG_BYTES || payload[0] != FISHBED_PONG_ID) {
        return 0;
    }
    message->token = fishbed_get_u16(payload + 1);
    return 1;
}

/* ClockRequest, from the slave: asks for the processing board's clock. */
#define FISHBED_CLOCK_REQUEST_ID 0x86
#define FISHBED_CLOCK_REQUEST_BYTES 3

typedef struct {
    uint16_t token; /* comes back in the ClockReport */
} fishbed_clock_request;

static inline uint8_t fishbed_encode_clock_request(const fishbed_clock_request *message,
                                                   uint8_t *payload)
{
    payload[0] = FISHBED_CLOCK_REQUEST_ID;
    fishbed_put_u16(payload + 1, message->token);
    return FISHBED_CLOCK_REQUEST_BYTES;
}

static inline uint8_t fishbed_decode_clock_request(fishbed_clock_request *message,
                                                   const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_CLOCK_REQUEST_BYTES || payload[0] != FISHBED_CLOCK_REQUEST_ID) {
        return 0;
    }
    message->token = fishbed_get_u16(payload + 1);
    return 1;
}

/* Codes of a BoardEvent. */
#define FISHBED_BOARD_EVENT_CODE_RESET 1
#define FISHBED_BOARD_EVENT_CODE_FAIL_SAFE_ON 2
#define FISHBED_BOARD_EVENT_CODE_FAIL_SAFE_OFF 3
#define FISHBED_BOARD_EVENT_CODE_OVERRUN 4
#define FISHBED_BOARD_EVENT_CODE_QUEUE_FULL 5
#define FISHBED_BOARD_EVENT_CODE_SENSOR_FAULT 6

/* Whether a payload is a message that the master sends: a fishbed_validator. */
static inline uint8_t fishbed_from_master(const uint8_t *payload, uint8_t length)
{
    if (length == 0) {
        return 0;
    }
    switch (payload[0]) {
    case FISHBED_TAIL_BEAT_ID: {
        fishbed_tail_beat message;
        return fishbed_decode_tail_beat(&message, payload, length);
    }
    case FISHBED_SET_REPORTING_ID: {
        fishbed_set_reporting message;
        return fishbed_decode_set_reporting(&message, payload, length);
    }
    case FISHBED_PING_ID: {
        fishbed_ping message;
        return fishbed_decode_ping(&message, payload, length);
    }
    case FISHBED_CLOCK_REPORT_ID: {
        fishbed_clock_report message;
        return fishbed_decode_clock_report(&message, payload, length);
    }
    default:
        return 0;
    }
}

/* Whether a payload is a message that the slave sends: a fishbed_validator. */
static inline uint8_t fishbed_from_slave(const uint8_t *payload, uint8_t length)
{
    if (length == 0) {
        return 0;
    }
    switch (payload[0]) {
    case FISHBED_SENSOR_REPORT_ID: {
        fishbed_sensor_report message;
        return fishbed_decode_sensor_report(&message, payload, length);
    }
    case FISHBED_GPS_REPORT_ID: {
        fishbed_gps_report message;
        return fishbed_decode_gps_report(&message, payload, length);
    }
    case FISHBED_COMMAND_APPLIED_ID: {
        fishbed_command_applied message;
        return fishbed_decode_command_applied(&message, payload, length);
    }
    case FISHBED_BOARD_EVENT_ID: {
        fishbed_board_event message;
        return fishbed_decode_board_event(&message, payload, length);
    }
    case FISHBED_PONG_ID: {
        fishbed_pong message;
        return fishbed_decode_pong(&message, payload, length);
    }
    case FISHBED_CLOCK_REQUEST_ID: {
        fishbed_clock_request message;
        return fishbed_decode_clock_request(&message, payload, length);
    }
    default:
        return 0;
    }
}

#endif
