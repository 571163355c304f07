/* Messages with their layouts. Made by python -m tools.message_reference from the table in
 * radio_802154/messages.py: change that and not this file. docs/messages.md has them in words.
 *
 * Members that end in _raw hold scaled integers: value = raw / ..._LSB_PER_UNIT. A message with
 * optional members has `valid`, a mask of ..._HAS_... bits; a member without its bit is no value.
 *
 * They are payloads of active messages, big-endian: the number is the AM type and travels in the
 * packet's header. Encoders write the payload and return its length; 0 where a member is outside
 * its range, and then the buffer is untouched. Decoders return 1; 0 where the payload is not this
 * message as an encoder makes it, and then the struct is undefined.
 */
#ifndef FISHBED_RADIO_MESSAGES_H
#define FISHBED_RADIO_MESSAGES_H

#include "fishbed_bytes.h"

#include <stdint.h>

/* Longest payload of the table. */
#define FISHBED_RADIO_LARGEST_MESSAGE 28

/* TailBeatCommand, from the base: tail-beat command. */
#define FISHBED_RADIO_TAIL_BEAT_COMMAND_AM_TYPE 0x10
#define FISHBED_RADIO_TAIL_BEAT_COMMAND_BYTES 10
#define FISHBED_RADIO_TAIL_BEAT_COMMAND_BIAS_RAD_LSB_PER_UNIT 20000
#define FISHBED_RADIO_TAIL_BEAT_COMMAND_BIAS_RAD_MIN (-32000)
#define FISHBED_RADIO_TAIL_BEAT_COMMAND_BIAS_RAD_MAX 32000
#define FISHBED_RADIO_TAIL_BEAT_COMMAND_AMPLITUDE_RAD_LSB_PER_UNIT 20000
#define FISHBED_RADIO_TAIL_BEAT_COMMAND_AMPLITUDE_RAD_MIN 0
#define FISHBED_RADIO_TAIL_BEAT_COMMAND_AMPLITUDE_RAD_MAX 32000
#define FISHBED_RADIO_TAIL_BEAT_COMMAND_FREQUENCY_HZ_LSB_PER_UNIT 1000
#define FISHBED_RADIO_TAIL_BEAT_COMMAND_FREQUENCY_HZ_MIN 0
#define FISHBED_RADIO_TAIL_BEAT_COMMAND_FREQUENCY_HZ_MAX 20000
#define FISHBED_RADIO_TAIL_BEAT_COMMAND_VALID_FOR_S_LSB_PER_UNIT 100

typedef struct {
    uint16_t command_id; /* chosen by the base, to tell commands apart */
    int16_t bias_rad_raw; /* rad; mean tail angle */
    int16_t amplitude_rad_raw; /* rad; half the tail's swing */
    uint16_t frequency_hz_raw; /* Hz; tail beats per second */
    uint16_t valid_for_s_raw; /* s; then the fail-safe takes over; 0: never */
} fishbed_radio_tail_beat_command;

static inline uint8_t fishbed_radio_encode_tail_beat_command(
        const fishbed_radio_tail_beat_command *message, uint8_t *payload)
{
    if (message->bias_rad_raw < FISHBED_RADIO_TAIL_BEAT_COMMAND_BIAS_RAD_MIN ||
            message->bias_rad_raw > FISHBED_RADIO_TAIL_BEAT_COMMAND_BIAS_RAD_MAX ||
            message->amplitude_rad_raw < FISHBED_RADIO_TAIL_BEAT_COMMAND_AMPLITUDE_RAD_MIN ||
            message->amplitude_rad_raw > FISHBED_RADIO_TAIL_BEAT_COMMAND_AMPLITUDE_RAD_MAX ||
            message->frequency_hz_raw > FISHBED_RADIO_TAIL_BEAT_COMMAND_FREQUENCY_HZ_MAX) {
        return 0;
    }
    fishbed_put_be_u16(payload + 0, message->command_id);
    fishbed_put_be_u16(payload + 2, (uint16_t)(message->bias_rad_raw));
    fishbed_put_be_u16(payload + 4, (uint16_t)(message->amplitude_rad_raw));
    fishbed_put_be_u16(payload + 6, message->frequency_hz_raw);
    fishbed_put_be_u16(payload + 8, message->valid_for_s_raw);
    return FISHBED_RADIO_TAIL_BEAT_COMMAND_BYTES;
}

static inline uint8_t fishbed_radio_decode_tail_beat_command(
        fishbed_radio_tail_beat_command *message, const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_RADIO_TAIL_BEAT_COMMAND_BYTES) {
        return 0;
    }
    message->command_id = fishbed_get_be_u16(payload + 0);
    message->bias_rad_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 2));
    message->amplitude_rad_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 4));
    message->frequency_hz_raw = fishbed_get_be_u16(payload + 6);
    message->valid_for_s_raw = fishbed_get_be_u16(payload + 8);
    if (message->bias_rad_raw < FISHBED_RADIO_TAIL_BEAT_COMMAND_BIAS_RAD_MIN ||
            message->bias_rad_raw > FISHBED_RADIO_TAIL_BEAT_COMMAND_BIAS_RAD_MAX ||
            message->amplitude_rad_raw < FISHBED_RADIO_TAIL_BEAT_COMMAND_AMPLITUDE_RAD_MIN ||
            message->amplitude_rad_raw > FISHBED_RADIO_TAIL_BEAT_COMMAND_AMPLITUDE_RAD_MAX ||
            message->frequency_hz_raw > FISHBED_RADIO_TAIL_BEAT_COMMAND_FREQUENCY_HZ_MAX) {
        return 0;
    }
    return 1;
}

/* TargetCommand, from the base: swim to a place. */
#define FISHBED_RADIO_TARGET_COMMAND_AM_TYPE 0x11
#define FISHBED_RADIO_TARGET_COMMAND_BYTES 6
#define FISHBED_RADIO_TARGET_COMMAND_X_M_LSB_PER_UNIT 1000
#define FISHBED_RADIO_TARGET_COMMAND_Y_M_LSB_PER_UNIT 1000

typedef struct {
    uint16_t command_id; /* chosen by the base, to tell commands apart */
    int16_t x_m_raw; /* m; in the tank; ±32.7 m, by the millimetre */
    int16_t y_m_raw; /* m; in the tank; ±32.7 m, by the millimetre */
} fishbed_radio_target_command;

static inline uint8_t fishbed_radio_encode_target_command(
        const fishbed_radio_target_command *message, uint8_t *payload)
{
    fishbed_put_be_u16(payload + 0, message->command_id);
    fishbed_put_be_u16(payload + 2, (uint16_t)(message->x_m_raw));
    fishbed_put_be_u16(payload + 4, (uint16_t)(message->y_m_raw));
    return FISHBED_RADIO_TARGET_COMMAND_BYTES;
}

static inline uint8_t fishbed_radio_decode_target_command(fishbed_radio_target_command *message,
                                                          const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_RADIO_TARGET_COMMAND_BYTES) {
        return 0;
    }
    message->command_id = fishbed_get_be_u16(payload + 0);
    message->x_m_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 2));
    message->y_m_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 4));
    return 1;
}

/* Pose, from the base: what the overhead camera saw. */
#define FISHBED_RADIO_POSE_AM_TYPE 0x12
#define FISHBED_RADIO_POSE_BYTES 10
#define FISHBED_RADIO_POSE_X_M_LSB_PER_UNIT 1000
#define FISHBED_RADIO_POSE_Y_M_LSB_PER_UNIT 1000
#define FISHBED_RADIO_POSE_HEADING_RAD_LSB_PER_UNIT 10430.378350470453

typedef struct {
    int16_t x_m_raw; /* m; in the tank; ±32.7 m, by the millimetre */
    int16_t y_m_raw; /* m; in the tank; ±32.7 m, by the millimetre */
    int16_t heading_rad_raw; /* rad;  */
    uint32_t camera_time_ms; /* ms; wraps after 49 days */
} fishbed_radio_pose;

static inline uint8_t fishbed_radio_encode_pose(const fishbed_radio_pose *message,
                                                uint8_t *payload)
{
    fishbed_put_be_u16(payload + 0, (uint16_t)(message->x_m_raw));
    fishbed_put_be_u16(payload + 2, (uint16_t)(message->y_m_raw));
    fishbed_put_be_u16(payload + 4, (uint16_t)(message->heading_rad_raw));
    fishbed_put_be_u32(payload + 6, message->camera_time_ms);
    return FISHBED_RADIO_POSE_BYTES;
}

static inline uint8_t fishbed_radio_decode_pose(fishbed_radio_pose *message,
                                                const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_RADIO_POSE_BYTES) {
        return 0;
    }
    message->x_m_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 0));
    message->y_m_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 2));
    message->heading_rad_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 4));
    message->camera_time_ms = fishbed_get_be_u32(payload + 6);
    return 1;
}

/* PoseBatch, from the base: what the overhead camera saw of several robots. */
#define FISHBED_RADIO_POSE_BATCH_AM_TYPE 0x13
#define FISHBED_RADIO_POSE_BATCH_BYTES 28
#define FISHBED_RADIO_POSE_BATCH_X_1_M_LSB_PER_UNIT 1000
#define FISHBED_RADIO_POSE_BATCH_Y_1_M_LSB_PER_UNIT 1000
#define FISHBED_RADIO_POSE_BATCH_HEADING_1_RAD_LSB_PER_UNIT 10430.378350470453
#define FISHBED_RADIO_POSE_BATCH_X_2_M_LSB_PER_UNIT 1000
#define FISHBED_RADIO_POSE_BATCH_Y_2_M_LSB_PER_UNIT 1000
#define FISHBED_RADIO_POSE_BATCH_HEADING_2_RAD_LSB_PER_UNIT 10430.378350470453
#define FISHBED_RADIO_POSE_BATCH_X_3_M_LSB_PER_UNIT 1000
#define FISHBED_RADIO_POSE_BATCH_Y_3_M_LSB_PER_UNIT 1000
#define FISHBED_RADIO_POSE_BATCH_HEADING_3_RAD_LSB_PER_UNIT 10430.378350470453

typedef struct {
    uint32_t camera_time_ms; /* ms; of the exposure; wraps after 49 days */
    uint16_t robot_1; /* its address; 0xFFFF: none here */
    int16_t x_1_m_raw; /* m; in the tank; ±32.7 m, by the millimetre */
    int16_t y_1_m_raw; /* m; in the tank; ±32.7 m, by the millimetre */
    int16_t heading_1_rad_raw; /* rad;  */
    uint16_t robot_2; /* its address; 0xFFFF: none here */
    int16_t x_2_m_raw; /* m; in the tank; ±32.7 m, by the millimetre */
    int16_t y_2_m_raw; /* m; in the tank; ±32.7 m, by the millimetre */
    int16_t heading_2_rad_raw; /* rad;  */
    uint16_t robot_3; /* its address; 0xFFFF: none here */
    int16_t x_3_m_raw; /* m; in the tank; ±32.7 m, by the millimetre */
    int16_t y_3_m_raw; /* m; in the tank; ±32.7 m, by the millimetre */
    int16_t heading_3_rad_raw; /* rad;  */
} fishbed_radio_pose_batch;

static inline uint8_t fishbed_radio_encode_pose_batch(const fishbed_radio_pose_batch *message,
                                                      uint8_t *payload)
{
    fishbed_put_be_u32(payload + 0, message->camera_time_ms);
    fishbed_put_be_u16(payload + 4, message->robot_1);
    fishbed_put_be_u16(payload + 6, (uint16_t)(message->x_1_m_raw));
    fishbed_put_be_u16(payload + 8, (uint16_t)(message->y_1_m_raw));
    fishbed_put_be_u16(payload + 10, (uint16_t)(message->heading_1_rad_raw));
    fishbed_put_be_u16(payload + 12, message->robot_2);
    fishbed_put_be_u16(payload + 14, (uint16_t)(message->x_2_m_raw));
    fishbed_put_be_u16(payload + 16, (uint16_t)(message->y_2_m_raw));
    fishbed_put_be_u16(payload + 18, (uint16_t)(message->heading_2_rad_raw));
    fishbed_put_be_u16(payload + 20, message->robot_3);
    fishbed_put_be_u16(payload + 22, (uint16_t)(message->x_3_m_raw));
    fishbed_put_be_u16(payload + 24, (uint16_t)(message->y_3_m_raw));
    fishbed_put_be_u16(payload + 26, (uint16_t)(message->heading_3_rad_raw));
    return FISHBED_RADIO_POSE_BATCH_BYTES;
}

static inline uint8_t fishbed_radio_decode_pose_batch(fishbed_radio_pose_batch *message,
                                                      const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_RADIO_POSE_BATCH_BYTES) {
        return 0;
    }
    message->camera_time_ms = fishbed_get_be_u32(payload + 0);
    message->robot_1 = fishbed_get_be_u16(payload + 4);
    message->x_1_m_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 6));
    message->y_1_m_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 8));
    message->heading_1_rad_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 10));
    message->robot_2 = fishbed_get_be_u16(payload + 12);
    message->x_2_m_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 14));
    message->y_2_m_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 16));
    message->heading_2_rad_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 18));
    message->robot_3 = fishbed_get_be_u16(payload + 20);
    message->x_3_m_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 22));
    message->y_3_m_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 24));
    message->heading_3_rad_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 26));
    return 1;
}

/* CommandReply, from the robot: what became of a command. */
#define FISHBED_RADIO_COMMAND_REPLY_AM_TYPE 0x20
#define FISHBED_RADIO_COMMAND_REPLY_BYTES 3

typedef struct {
    uint16_t command_id; /* chosen by the base, to tell commands apart */
    uint8_t status; /* see CommandStatus */
} fishbed_radio_command_reply;

static inline uint8_t fishbed_radio_encode_command_reply(
                                                         const fishbed_radio_command_reply *message,
                                                         uint8_t *payload)
{
    fishbed_put_be_u16(payload + 0, message->command_id);
    payload[2] = message->status;
    return FISHBED_RADIO_COMMAND_REPLY_BYTES;
}

static inline uint8_t fishbed_radio_decode_command_reply(fishbed_radio_command_reply *message,
                                                         const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_RADIO_COMMAND_REPLY_BYTES) {
        return 0;
    }
    message->command_id = fishbed_get_be_u16(payload + 0);
    message->status = payload[2];
    return 1;
}

/* Telemetry, from the robot: state of the robot. */
#define FISHBED_RADIO_TELEMETRY_AM_TYPE 0x21
#define FISHBED_RADIO_TELEMETRY_BYTES 27
#define FISHBED_RADIO_TELEMETRY_TIME_S_LSB_PER_UNIT 1000
#define FISHBED_RADIO_TELEMETRY_HEADING_RAD_LSB_PER_UNIT 10430.378350470453
#define FISHBED_RADIO_TELEMETRY_HAS_HEADING_RAD 0x0001u
#define FISHBED_RADIO_TELEMETRY_GYRO_Z_RAD_S_LSB_PER_UNIT 2000
#define FISHBED_RADIO_TELEMETRY_HAS_GYRO_Z_RAD_S 0x0002u
#define FISHBED_RADIO_TELEMETRY_TAIL_BIAS_RAD_LSB_PER_UNIT 20000
#define FISHBED_RADIO_TELEMETRY_HAS_TAIL_BIAS_RAD 0x0004u
#define FISHBED_RADIO_TELEMETRY_BATTERY_V_LSB_PER_UNIT 1000
#define FISHBED_RADIO_TELEMETRY_HAS_BATTERY_V 0x0008u
#define FISHBED_RADIO_TELEMETRY_TEMPERATURE_C_LSB_PER_UNIT 100
#define FISHBED_RADIO_TELEMETRY_HAS_TEMPERATURE_C 0x0010u
#define FISHBED_RADIO_TELEMETRY_WATER_QUALITY_UG_L_LSB_PER_UNIT 10
#define FISHBED_RADIO_TELEMETRY_HAS_WATER_QUALITY_UG_L 0x0020u

typedef struct {
    uint8_t valid;
    uint32_t time_s_raw; /* s; since reset; wraps after 49 days */
    uint16_t sequence; /* counts telemetry, wraps */
    int16_t heading_rad_raw; /* rad;  */
    int16_t gyro_z_rad_s_raw; /* rad/s; yaw rate, ±16.4 */
    int16_t tail_bias_rad_raw; /* rad; commanded, ±1.6 */
    uint16_t battery_v_raw; /* V; pack voltage */
    int16_t temperature_c_raw; /* °C; water temperature */
    uint16_t water_quality_ug_l_raw; /* µg/L; oil or chlorophyll */
    uint32_t samples_stored; /* in the log since it was erased */
    uint8_t samples_lost; /* that could not be stored; 255 means more */
    uint16_t last_command_id; /* that was applied */
    uint8_t flags; /* see TelemetryFlag */
} fishbed_radio_telemetry;

static inline uint8_t fishbed_radio_encode_telemetry(const fishbed_radio_telemetry *message,
                                                     uint8_t *payload)
{
    if (message->valid > 63) {
        return 0;
    }
    payload[0] = message->valid;
    fishbed_put_be_u32(payload + 1, message->time_s_raw);
    fishbed_put_be_u16(payload + 5, message->sequence);
    fishbed_put_be_u16(payload + 7, (uint16_t)(message->valid &
            FISHBED_RADIO_TELEMETRY_HAS_HEADING_RAD ? message->heading_rad_raw : 0));
    fishbed_put_be_u16(payload + 9, (uint16_t)(message->valid &
            FISHBED_RADIO_TELEMETRY_HAS_GYRO_Z_RAD_S ? message->gyro_z_rad_s_raw : 0));
    fishbed_put_be_u16(payload + 11, (uint16_t)(message->valid &
            FISHBED_RADIO_TELEMETRY_HAS_TAIL_BIAS_RAD ? message->tail_bias_rad_raw : 0));
    fishbed_put_be_u16(payload + 13, (uint16_t)(message->valid &
            FISHBED_RADIO_TELEMETRY_HAS_BATTERY_V ? message->battery_v_raw : 0));
    fishbed_put_be_u16(payload + 15, (uint16_t)(message->valid &
            FISHBED_RADIO_TELEMETRY_HAS_TEMPERATURE_C ? message->temperature_c_raw : 0));
    fishbed_put_be_u16(payload + 17, (uint16_t)(message->valid &
            FISHBED_RADIO_TELEMETRY_HAS_WATER_QUALITY_UG_L ? message->water_quality_ug_l_raw : 0));
    fishbed_put_be_u32(payload + 19, message->samples_stored);
    payload[23] = message->samples_lost;
    fishbed_put_be_u16(payload + 24, message->last_command_id);
    payload[26] = message->flags;
    return FISHBED_RADIO_TELEMETRY_BYTES;
}

static inline uint8_t fishbed_radio_decode_telemetry(fishbed_radio_telemetry *message,
                                                     const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_RADIO_TELEMETRY_BYTES) {
        return 0;
    }
    message->valid = payload[0];
    message->time_s_raw = fishbed_get_be_u32(payload + 1);
    message->sequence = fishbed_get_be_u16(payload + 5);
    message->heading_rad_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 7));
    message->gyro_z_rad_s_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 9));
    message->tail_bias_rad_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 11));
    message->battery_v_raw = fishbed_get_be_u16(payload + 13);
    message->temperature_c_raw = fishbed_signed_16(fishbed_get_be_u16(payload + 15));
    message->water_quality_ug_l_raw = fishbed_get_be_u16(payload + 17);
    message->samples_stored = fishbed_get_be_u32(payload + 19);
    message->samples_lost = payload[23];
    message->last_command_id = fishbed_get_be_u16(payload + 24);
    message->flags = payload[26];
    if (message->valid > 63 || (!(message->valid & FISHBED_RADIO_TELEMETRY_HAS_HEADING_RAD) &&
            message->heading_rad_raw != 0) || (!(message->valid &
            FISHBED_RADIO_TELEMETRY_HAS_GYRO_Z_RAD_S) && message->gyro_z_rad_s_raw != 0) ||
            (!(message->valid & FISHBED_RADIO_TELEMETRY_HAS_TAIL_BIAS_RAD) &&
            message->tail_bias_rad_raw != 0) || (!(message->valid &
            FISHBED_RADIO_TELEMETRY_HAS_BATTERY_V) && message->battery_v_raw != 0) ||
            (!(message->valid & FISHBED_RADIO_TELEMETRY_HAS_TEMPERATURE_C) &&
            message->temperature_c_raw != 0) || (!(message->valid &
            FISHBED_RADIO_TELEMETRY_HAS_WATER_QUALITY_UG_L) && message->water_quality_ug_l_raw !=
            0)) {
        return 0;
    }
    return 1;
}

/* What became of a command. */
#define FISHBED_RADIO_COMMAND_STATUS_ACCEPTED 0
#define FISHBED_RADIO_COMMAND_STATUS_APPLIED 1
#define FISHBED_RADIO_COMMAND_STATUS_REFUSED 2
#define FISHBED_RADIO_COMMAND_STATUS_DUPLICATE 3
#define FISHBED_RADIO_COMMAND_STATUS_UNREACHABLE 4

/* Flags of a Telemetry. */
#define FISHBED_RADIO_TELEMETRY_FLAG_FAIL_SAFE 1
#define FISHBED_RADIO_TELEMETRY_FLAG_HEADING_CONTROL 2
#define FISHBED_RADIO_TELEMETRY_FLAG_TARGET_REACHED 4
#define FISHBED_RADIO_TELEMETRY_FLAG_GPS_FIX 8
#define FISHBED_RADIO_TELEMETRY_FLAG_LINK_DOWN 16
#define FISHBED_RADIO_TELEMETRY_FLAG_STORAGE_FULL 32
#define FISHBED_RADIO_TELEMETRY_FLAG_RESET 64

/* Whether a payload is a message that the base sends. */
static inline uint8_t fishbed_radio_from_base(uint8_t am_type, const uint8_t *payload,
                                              uint8_t length)
{
    switch (am_type) {
    case FISHBED_RADIO_TAIL_BEAT_COMMAND_AM_TYPE: {
        fishbed_radio_tail_beat_command message;
        return fishbed_radio_decode_tail_beat_command(&message, payload, length);
    }
    case FISHBED_RADIO_TARGET_COMMAND_AM_TYPE: {
        fishbed_radio_target_command message;
        return fishbed_radio_decode_target_command(&message, payload, length);
    }
    case FISHBED_RADIO_POSE_AM_TYPE: {
        fishbed_radio_pose message;
        return fishbed_radio_decode_pose(&message, payload, length);
    }
    case FISHBED_RADIO_POSE_BATCH_AM_TYPE: {
        fishbed_radio_pose_batch message;
        return fishbed_radio_decode_pose_batch(&message, payload, length);
    }
    default:
        return 0;
    }
}

/* Whether a payload is a message that the robot sends. */
static inline uint8_t fishbed_radio_from_robot(uint8_t am_type, const uint8_t *payload,
                                               uint8_t length)
{
    switch (am_type) {
    case FISHBED_RADIO_COMMAND_REPLY_AM_TYPE: {
        fishbed_radio_command_reply message;
        return fishbed_radio_decode_command_reply(&message, payload, length);
    }
    case FISHBED_RADIO_TELEMETRY_AM_TYPE: {
        fishbed_radio_telemetry message;
        return fishbed_radio_decode_telemetry(&message, payload, length);
    }
    default:
        return 0;
    }
}

#endif
