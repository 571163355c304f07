/* Messages with their layouts. Made by python -m tools.message_reference from the table in
 * spi_bus/plant_messages.py: change that and not this file. docs/messages.md has them in words.
 *
 * Members that end in _raw hold scaled integers: value = raw / ..._LSB_PER_UNIT. A message with
 * optional members has `valid`, a mask of ..._HAS_... bits; a member without its bit is no value.
 *
 * They go over a link of their own, to the host of a plant in the loop: sensor_sample comes as
 * FISHBED_EVENT_STREAM and servo_pulse goes by fishbed_send_newest; all others are messages.
 * Encoders write number and fields and return the length; 0 where a member is outside its range,
 * and then the buffer is untouched. Decoders return 1; 0 where the payload is not this message as
 * an encoder makes it, and then the struct is undefined.
 */
#ifndef FISHBED_PLANT_MESSAGES_H
#define FISHBED_PLANT_MESSAGES_H

#include "fishbed_bytes.h"

#include <stdint.h>

/* Longest payload of the table; FISHBED_MAX_PAYLOAD of fishbed_link.h must hold it. */
#define FISHBED_PLANT_LARGEST_MESSAGE 60

/* HostGreeting, from the master: rate of the samples. */
#define FISHBED_PLANT_HOST_GREETING_ID 0x21
#define FISHBED_PLANT_HOST_GREETING_BYTES 10
#define FISHBED_PLANT_HOST_GREETING_PERIOD_US_MIN 1
#define FISHBED_PLANT_HOST_GREETING_PERIOD_US_MAX UINT32_C(4294967295)

typedef struct {
    uint8_t version; /* of this table */
    uint32_t period_us; /* µs; between samples */
    uint32_t stale_after_us; /* µs; after so long without one */
} fishbed_plant_host_greeting;

static inline uint8_t fishbed_plant_encode_host_greeting(
                                                         const fishbed_plant_host_greeting *message,
                                                         uint8_t *payload)
{
    if (message->period_us < FISHBED_PLANT_HOST_GREETING_PERIOD_US_MIN) {
        return 0;
    }
    payload[0] = FISHBED_PLANT_HOST_GREETING_ID;
    payload[1] = message->version;
    fishbed_put_u32(payload + 2, message->period_us);
    fishbed_put_u32(payload + 6, message->stale_after_us);
    return FISHBED_PLANT_HOST_GREETING_BYTES;
}

static inline uint8_t fishbed_plant_decode_host_greeting(fishbed_plant_host_greeting *message,
                                                         const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_PLANT_HOST_GREETING_BYTES || payload[0] != FISHBED_PLANT_HOST_GREETING_ID)
            {
        return 0;
    }
    message->version = payload[1];
    message->period_us = fishbed_get_u32(payload + 2);
    message->stale_after_us = fishbed_get_u32(payload + 6);
    if (message->period_us < FISHBED_PLANT_HOST_GREETING_PERIOD_US_MIN) {
        return 0;
    }
    return 1;
}

/* SensorSample, from the master: all raw inputs once; a stream. */
#define FISHBED_PLANT_SENSOR_SAMPLE_ID 0x22
#define FISHBED_PLANT_SENSOR_SAMPLE_BYTES 60
#define FISHBED_PLANT_SENSOR_SAMPLE_AN0_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN0_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN0 0x0001u
#define FISHBED_PLANT_SENSOR_SAMPLE_AN1_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN1_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN1 0x0002u
#define FISHBED_PLANT_SENSOR_SAMPLE_AN2_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN2_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN2 0x0004u
#define FISHBED_PLANT_SENSOR_SAMPLE_AN3_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN3_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN3 0x0008u
#define FISHBED_PLANT_SENSOR_SAMPLE_AN4_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN4_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN4 0x0010u
#define FISHBED_PLANT_SENSOR_SAMPLE_AN5_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN5_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN5 0x0020u
#define FISHBED_PLANT_SENSOR_SAMPLE_AN6_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN6_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN6 0x0040u
#define FISHBED_PLANT_SENSOR_SAMPLE_AN7_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN7_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN7 0x0080u
#define FISHBED_PLANT_SENSOR_SAMPLE_AN8_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN8_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN8 0x0100u
#define FISHBED_PLANT_SENSOR_SAMPLE_AN9_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN9_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN9 0x0200u
#define FISHBED_PLANT_SENSOR_SAMPLE_AN10_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN10_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN10 0x0400u
#define FISHBED_PLANT_SENSOR_SAMPLE_AN11_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN11_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN11 0x0800u
#define FISHBED_PLANT_SENSOR_SAMPLE_AN12_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN12_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN12 0x1000u
#define FISHBED_PLANT_SENSOR_SAMPLE_AN13_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN13_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN13 0x2000u
#define FISHBED_PLANT_SENSOR_SAMPLE_AN14_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN14_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN14 0x4000u
#define FISHBED_PLANT_SENSOR_SAMPLE_AN15_MIN 0
#define FISHBED_PLANT_SENSOR_SAMPLE_AN15_MAX 4095
#define FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN15 0x8000u

typedef struct {
    uint16_t valid;
    uint32_t number; /* counts from 1; wraps */
    uint64_t host_time_us; /* µs; host's clock since the run began */
    uint8_t status; /* bits of SampleStatus */
    uint16_t an0; /* counts of AN0 */
    uint16_t an1; /* counts of AN1 */
    uint16_t an2; /* counts of AN2 */
    uint16_t an3; /* counts of AN3 */
    uint16_t an4; /* counts of AN4 */
    uint16_t an5; /* counts of AN5 */
    uint16_t an6; /* counts of AN6 */
    uint16_t an7; /* counts of AN7 */
    uint16_t an8; /* counts of AN8 */
    uint16_t an9; /* counts of AN9 */
    uint16_t an10; /* counts of AN10 */
    uint16_t an11; /* counts of AN11 */
    uint16_t an12; /* counts of AN12 */
    uint16_t an13; /* counts of AN13 */
    uint16_t an14; /* counts of AN14 */
    uint16_t an15; /* counts of AN15 */
    uint8_t status_reg_a; /* STATUS_REG_A of the LSM303DLH */
    uint8_t out_x_l_a; /* OUT_X_L_A of the LSM303DLH */
    uint8_t out_x_h_a; /* OUT_X_H_A of the LSM303DLH */
    uint8_t out_y_l_a; /* OUT_Y_L_A of the LSM303DLH */
    uint8_t out_y_h_a; /* OUT_Y_H_A of the LSM303DLH */
    uint8_t out_z_l_a; /* OUT_Z_L_A of the LSM303DLH */
    uint8_t out_z_h_a; /* OUT_Z_H_A of the LSM303DLH */
    uint8_t out_x_h_m; /* OUT_X_H_M of the LSM303DLH */
    uint8_t out_x_l_m; /* OUT_X_L_M of the LSM303DLH */
    uint8_t out_y_h_m; /* OUT_Y_H_M of the LSM303DLH */
    uint8_t out_y_l_m; /* OUT_Y_L_M of the LSM303DLH */
    uint8_t out_z_h_m; /* OUT_Z_H_M of the LSM303DLH */
    uint8_t out_z_l_m; /* OUT_Z_L_M of the LSM303DLH */
    uint8_t sr_reg_m; /* SR_REG_M of the LSM303DLH */
} fishbed_plant_sensor_sample;

static inline uint8_t fishbed_plant_encode_sensor_sample(
                                                         const fishbed_plant_sensor_sample *message,
                                                         uint8_t *payload)
{
    if (message->host_time_us > UINT64_C(281474976710655) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN0) && (message->an0 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN0_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN1) && (message->an1 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN1_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN2) && (message->an2 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN2_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN3) && (message->an3 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN3_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN4) && (message->an4 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN4_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN5) && (message->an5 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN5_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN6) && (message->an6 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN6_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN7) && (message->an7 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN7_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN8) && (message->an8 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN8_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN9) && (message->an9 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN9_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN10) && (message->an10 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN10_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN11) && (message->an11 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN11_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN12) && (message->an12 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN12_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN13) && (message->an13 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN13_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN14) && (message->an14 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN14_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN15) && (message->an15 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN15_MAX))) {
        return 0;
    }
    payload[0] = FISHBED_PLANT_SENSOR_SAMPLE_ID;
    fishbed_put_u16(payload + 1, message->valid);
    fishbed_put_u32(payload + 3, message->number);
    fishbed_put(payload + 7, message->host_time_us, 6);
    payload[13] = message->status;
    fishbed_put_u16(payload + 14, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN0 ?
            message->an0 : 0));
    fishbed_put_u16(payload + 16, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN1 ?
            message->an1 : 0));
    fishbed_put_u16(payload + 18, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN2 ?
            message->an2 : 0));
    fishbed_put_u16(payload + 20, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN3 ?
            message->an3 : 0));
    fishbed_put_u16(payload + 22, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN4 ?
            message->an4 : 0));
    fishbed_put_u16(payload + 24, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN5 ?
            message->an5 : 0));
    fishbed_put_u16(payload + 26, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN6 ?
            message->an6 : 0));
    fishbed_put_u16(payload + 28, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN7 ?
            message->an7 : 0));
    fishbed_put_u16(payload + 30, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN8 ?
            message->an8 : 0));
    fishbed_put_u16(payload + 32, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN9 ?
            message->an9 : 0));
    fishbed_put_u16(payload + 34, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN10 ?
            message->an10 : 0));
    fishbed_put_u16(payload + 36, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN11 ?
            message->an11 : 0));
    fishbed_put_u16(payload + 38, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN12 ?
            message->an12 : 0));
    fishbed_put_u16(payload + 40, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN13 ?
            message->an13 : 0));
    fishbed_put_u16(payload + 42, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN14 ?
            message->an14 : 0));
    fishbed_put_u16(payload + 44, (uint16_t)(message->valid & FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN15 ?
            message->an15 : 0));
    payload[46] = message->status_reg_a;
    payload[47] = message->out_x_l_a;
    payload[48] = message->out_x_h_a;
    payload[49] = message->out_y_l_a;
    payload[50] = message->out_y_h_a;
    payload[51] = message->out_z_l_a;
    payload[52] = message->out_z_h_a;
    payload[53] = message->out_x_h_m;
    payload[54] = message->out_x_l_m;
    payload[55] = message->out_y_h_m;
    payload[56] = message->out_y_l_m;
    payload[57] = message->out_z_h_m;
    payload[58] = message->out_z_l_m;
    payload[59] = message->sr_reg_m;
    return FISHBED_PLANT_SENSOR_SAMPLE_BYTES;
}

static inline uint8_t fishbed_plant_decode_sensor_sample(fishbed_plant_sensor_sample *message,
                                                         const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_PLANT_SENSOR_SAMPLE_BYTES || payload[0] != FISHBED_PLANT_SENSOR_SAMPLE_ID)
            {
        return 0;
    }
    message->valid = fishbed_get_u16(payload + 1);
    message->number = fishbed_get_u32(payload + 3);
    message->host_time_us = fishbed_get(payload + 7, 6);
    message->status = payload[13];
    message->an0 = fishbed_get_u16(payload + 14);
    message->an1 = fishbed_get_u16(payload + 16);
    message->an2 = fishbed_get_u16(payload + 18);
    message->an3 = fishbed_get_u16(payload + 20);
    message->an4 = fishbed_get_u16(payload + 22);
    message->an5 = fishbed_get_u16(payload + 24);
    message->an6 = fishbed_get_u16(payload + 26);
    message->an7 = fishbed_get_u16(payload + 28);
    message->an8 = fishbed_get_u16(payload + 30);
    message->an9 = fishbed_get_u16(payload + 32);
    message->an10 = fishbed_get_u16(payload + 34);
    message->an11 = fishbed_get_u16(payload + 36);
    message->an12 = fishbed_get_u16(payload + 38);
    message->an13 = fishbed_get_u16(payload + 40);
    message->an14 = fishbed_get_u16(payload + 42);
    message->an15 = fishbed_get_u16(payload + 44);
    message->status_reg_a = payload[46];
    message->out_x_l_a = payload[47];
    message->out_x_h_a = payload[48];
    message->out_y_l_a = payload[49];
    message->out_y_h_a = payload[50];
    message->out_z_l_a = payload[51];
    message->out_z_h_a = payload[52];
    message->out_x_h_m = payload[53];
    message->out_x_l_m = payload[54];
    message->out_y_h_m = payload[55];
    message->out_y_l_m = payload[56];
    message->out_z_h_m = payload[57];
    message->out_z_l_m = payload[58];
    message->sr_reg_m = payload[59];
    if (message->host_time_us > UINT64_C(281474976710655) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN0) && (message->an0 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN0_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN1) && (message->an1 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN1_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN2) && (message->an2 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN2_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN3) && (message->an3 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN3_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN4) && (message->an4 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN4_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN5) && (message->an5 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN5_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN6) && (message->an6 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN6_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN7) && (message->an7 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN7_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN8) && (message->an8 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN8_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN9) && (message->an9 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN9_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN10) && (message->an10 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN10_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN11) && (message->an11 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN11_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN12) && (message->an12 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN12_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN13) && (message->an13 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN13_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN14) && (message->an14 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN14_MAX)) || ((message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN15) && (message->an15 >
            FISHBED_PLANT_SENSOR_SAMPLE_AN15_MAX)) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN0) && message->an0 != 0) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN1) && message->an1 != 0) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN2) && message->an2 != 0) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN3) && message->an3 != 0) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN4) && message->an4 != 0) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN5) && message->an5 != 0) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN6) && message->an6 != 0) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN7) && message->an7 != 0) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN8) && message->an8 != 0) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN9) && message->an9 != 0) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN10) && message->an10 != 0) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN11) && message->an11 != 0) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN12) && message->an12 != 0) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN13) && message->an13 != 0) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN14) && message->an14 != 0) || (!(message->valid &
            FISHBED_PLANT_SENSOR_SAMPLE_HAS_AN15) && message->an15 != 0)) {
        return 0;
    }
    return 1;
}

/* NmeaCharacters, from the master: characters of the GPS. */
#define FISHBED_PLANT_NMEA_CHARACTERS_ID 0x23
#define FISHBED_PLANT_NMEA_CHARACTERS_BYTES 26
#define FISHBED_PLANT_NMEA_CHARACTERS_BAUD_MIN 300
#define FISHBED_PLANT_NMEA_CHARACTERS_BAUD_MAX UINT16_C(65535)
#define FISHBED_PLANT_NMEA_CHARACTERS_COUNT_MIN 1
#define FISHBED_PLANT_NMEA_CHARACTERS_COUNT_MAX 16

typedef struct {
    uint64_t due_us; /* µs; host's clock when the first is complete */
    uint16_t baud; /* Bd; of the receiver's line */
    uint8_t count; /* characters used */
    uint8_t character_0; /* zero where unused */
    uint8_t character_1; /* zero where unused */
    uint8_t character_2; /* zero where unused */
    uint8_t character_3; /* zero where unused */
    uint8_t character_4; /* zero where unused */
    uint8_t character_5; /* zero where unused */
    uint8_t character_6; /* zero where unused */
    uint8_t character_7; /* zero where unused */
    uint8_t character_8; /* zero where unused */
    uint8_t character_9; /* zero where unused */
    uint8_t character_10; /* zero where unused */
    uint8_t character_11; /* zero where unused */
    uint8_t character_12; /* zero where unused */
    uint8_t character_13; /* zero where unused */
    uint8_t character_14; /* zero where unused */
    uint8_t character_15; /* zero where unused */
} fishbed_plant_nmea_characters;

static inline uint8_t fishbed_plant_encode_nmea_characters(
        const fishbed_plant_nmea_characters *message, uint8_t *payload)
{
    if (message->due_us > UINT64_C(281474976710655) || message->baud <
            FISHBED_PLANT_NMEA_CHARACTERS_BAUD_MIN || message->count <
            FISHBED_PLANT_NMEA_CHARACTERS_COUNT_MIN || message->count >
            FISHBED_PLANT_NMEA_CHARACTERS_COUNT_MAX) {
        return 0;
    }
    payload[0] = FISHBED_PLANT_NMEA_CHARACTERS_ID;
    fishbed_put(payload + 1, message->due_us, 6);
    fishbed_put_u16(payload + 7, message->baud);
    payload[9] = message->count;
    payload[10] = message->character_0;
    payload[11] = message->character_1;
    payload[12] = message->character_2;
    payload[13] = message->character_3;
    payload[14] = message->character_4;
    payload[15] = message->character_5;
    payload[16] = message->character_6;
    payload[17] = message->character_7;
    payload[18] = message->character_8;
    payload[19] = message->character_9;
    payload[20] = message->character_10;
    payload[21] = message->character_11;
    payload[22] = message->character_12;
    payload[23] = message->character_13;
    payload[24] = message->character_14;
    payload[25] = message->character_15;
    return FISHBED_PLANT_NMEA_CHARACTERS_BYTES;
}

static inline uint8_t fishbed_plant_decode_nmea_characters(fishbed_plant_nmea_characters *message,
                                                           const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_PLANT_NMEA_CHARACTERS_BYTES || payload[0] !=
            FISHBED_PLANT_NMEA_CHARACTERS_ID) {
        return 0;
    }
    message->due_us = fishbed_get(payload + 1, 6);
    message->baud = fishbed_get_u16(payload + 7);
    message->count = payload[9];
    message->character_0 = payload[10];
    message->character_1 = payload[11];
    message->character_2 = payload[12];
    message->character_3 = payload[13];
    message->character_4 = payload[14];
    message->character_5 = payload[15];
    message->character_6 = payload[16];
    message->character_7 = payload[17];
    message->character_8 = payload[18];
    message->character_9 = payload[19];
    message->character_10 = payload[20];
    message->character_11 = payload[21];
    message->character_12 = payload[22];
    message->character_13 = payload[23];
    message->character_14 = payload[24];
    message->character_15 = payload[25];
    if (message->due_us > UINT64_C(281474976710655) || message->baud <
            FISHBED_PLANT_NMEA_CHARACTERS_BAUD_MIN || message->count <
            FISHBED_PLANT_NMEA_CHARACTERS_COUNT_MIN || message->count >
            FISHBED_PLANT_NMEA_CHARACTERS_COUNT_MAX) {
        return 0;
    }
    return 1;
}

/* GpsPulse, from the master: the GPS's pulse a second. */
#define FISHBED_PLANT_GPS_PULSE_ID 0x24
#define FISHBED_PLANT_GPS_PULSE_BYTES 11

typedef struct {
    uint64_t rise_us; /* µs; host's clock */
    uint32_t width_us; /* µs; of the pulse */
} fishbed_plant_gps_pulse;

static inline uint8_t fishbed_plant_encode_gps_pulse(const fishbed_plant_gps_pulse *message,
                                                     uint8_t *payload)
{
    if (message->rise_us > UINT64_C(281474976710655)) {
        return 0;
    }
    payload[0] = FISHBED_PLANT_GPS_PULSE_ID;
    fishbed_put(payload + 1, message->rise_us, 6);
    fishbed_put_u32(payload + 7, message->width_us);
    return FISHBED_PLANT_GPS_PULSE_BYTES;
}

static inline uint8_t fishbed_plant_decode_gps_pulse(fishbed_plant_gps_pulse *message,
                                                     const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_PLANT_GPS_PULSE_BYTES || payload[0] != FISHBED_PLANT_GPS_PULSE_ID) {
        return 0;
    }
    message->rise_us = fishbed_get(payload + 1, 6);
    message->width_us = fishbed_get_u32(payload + 7);
    if (message->rise_us > UINT64_C(281474976710655)) {
        return 0;
    }
    return 1;
}

/* BoardGreeting, from the slave: what the board is. */
#define FISHBED_PLANT_BOARD_GREETING_ID 0xA1
#define FISHBED_PLANT_BOARD_GREETING_BYTES 7
#define FISHBED_PLANT_BOARD_GREETING_MOST_RATE_HZ_MIN 1
#define FISHBED_PLANT_BOARD_GREETING_MOST_RATE_HZ_MAX UINT16_C(65535)
#define FISHBED_PLANT_BOARD_GREETING_GPS_FITTED_MIN 0
#define FISHBED_PLANT_BOARD_GREETING_GPS_FITTED_MAX 1

typedef struct {
    uint8_t version; /* of this table */
    uint16_t most_rate_hz; /* Hz; fastest samples that it takes */
    uint16_t analog_inputs; /* bit n: it converts ANn */
    uint8_t gps_fitted; /* it listens to a GPS receiver */
} fishbed_plant_board_greeting;

static inline uint8_t fishbed_plant_encode_board_greeting(
        const fishbed_plant_board_greeting *message, uint8_t *payload)
{
    if (message->most_rate_hz < FISHBED_PLANT_BOARD_GREETING_MOST_RATE_HZ_MIN || message->gps_fitted
            > FISHBED_PLANT_BOARD_GREETING_GPS_FITTED_MAX) {
        return 0;
    }
    payload[0] = FISHBED_PLANT_BOARD_GREETING_ID;
    payload[1] = message->version;
    fishbed_put_u16(payload + 2, message->most_rate_hz);
    fishbed_put_u16(payload + 4, message->analog_inputs);
    payload[6] = message->gps_fitted;
    return FISHBED_PLANT_BOARD_GREETING_BYTES;
}

static inline uint8_t fishbed_plant_decode_board_greeting(fishbed_plant_board_greeting *message,
                                                          const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_PLANT_BOARD_GREETING_BYTES || payload[0] !=
            FISHBED_PLANT_BOARD_GREETING_ID) {
        return 0;
    }
    message->version = payload[1];
    message->most_rate_hz = fishbed_get_u16(payload + 2);
    message->analog_inputs = fishbed_get_u16(payload + 4);
    message->gps_fitted = payload[6];
    if (message->most_rate_hz < FISHBED_PLANT_BOARD_GREETING_MOST_RATE_HZ_MIN || message->gps_fitted
            > FISHBED_PLANT_BOARD_GREETING_GPS_FITTED_MAX) {
        return 0;
    }
    return 1;
}

/* ServoPulse, from the slave: a pulse of the servo output; a stream. */
#define FISHBED_PLANT_SERVO_PULSE_ID 0xA2
#define FISHBED_PLANT_SERVO_PULSE_BYTES 21
#define FISHBED_PLANT_SERVO_PULSE_WIDTH_S_LSB_PER_UNIT 10000000

typedef struct {
    uint32_t number; /* counts from 1; wraps */
    uint64_t board_time_us; /* µs; board's clock since its reset */
    uint16_t width_s_raw; /* s; high time */
    uint32_t sample; /* number of the newest sample; 0 before the first */
    uint32_t sample_age_us; /* µs; since that sample came */
} fishbed_plant_servo_pulse;

static inline uint8_t fishbed_plant_encode_servo_pulse(const fishbed_plant_servo_pulse *message,
                                                       uint8_t *payload)
{
    if (message->board_time_us > UINT64_C(281474976710655)) {
        return 0;
    }
    payload[0] = FISHBED_PLANT_SERVO_PULSE_ID;
    fishbed_put_u32(payload + 1, message->number);
    fishbed_put(payload + 5, message->board_time_us, 6);
    fishbed_put_u16(payload + 11, message->width_s_raw);
    fishbed_put_u32(payload + 13, message->sample);
    fishbed_put_u32(payload + 17, message->sample_age_us);
    return FISHBED_PLANT_SERVO_PULSE_BYTES;
}

static inline uint8_t fishbed_plant_decode_servo_pulse(fishbed_plant_servo_pulse *message,
                                                       const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_PLANT_SERVO_PULSE_BYTES || payload[0] != FISHBED_PLANT_SERVO_PULSE_ID) {
        return 0;
    }
    message->number = fishbed_get_u32(payload + 1);
    message->board_time_us = fishbed_get(payload + 5, 6);
    message->width_s_raw = fishbed_get_u16(payload + 11);
    message->sample = fishbed_get_u32(payload + 13);
    message->sample_age_us = fishbed_get_u32(payload + 17);
    if (message->board_time_us > UINT64_C(281474976710655)) {
        return 0;
    }
    return 1;
}

/* RegisterWrite, from the slave: a register of a chip was written. */
#define FISHBED_PLANT_REGISTER_WRITE_ID 0xA3
#define FISHBED_PLANT_REGISTER_WRITE_BYTES 4
#define FISHBED_PLANT_REGISTER_WRITE_ADDRESS_MIN 0
#define FISHBED_PLANT_REGISTER_WRITE_ADDRESS_MAX 127

typedef struct {
    uint8_t address; /* of the chip, seven bits */
    uint8_t sub_address; /* register, without an auto-increment bit */
    uint8_t value; /* written */
} fishbed_plant_register_write;

static inline uint8_t fishbed_plant_encode_register_write(
        const fishbed_plant_register_write *message, uint8_t *payload)
{
    if (message->address > FISHBED_PLANT_REGISTER_WRITE_ADDRESS_MAX) {
        return 0;
    }
    payload[0] = FISHBED_PLANT_REGISTER_WRITE_ID;
    payload[1] = message->address;
    payload[2] = message->sub_address;
    payload[3] = message->value;
    return FISHBED_PLANT_REGISTER_WRITE_BYTES;
}

static inline uint8_t fishbed_plant_decode_register_write(fishbed_plant_register_write *message,
                                                          const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_PLANT_REGISTER_WRITE_BYTES || payload[0] !=
            FISHBED_PLANT_REGISTER_WRITE_ID) {
        return 0;
    }
    message->address = payload[1];
    message->sub_address = payload[2];
    message->value = payload[3];
    if (message->address > FISHBED_PLANT_REGISTER_WRITE_ADDRESS_MAX) {
        return 0;
    }
    return 1;
}

/* BoardStatus, from the slave: counters, once a second. */
#define FISHBED_PLANT_BOARD_STATUS_ID 0xA4
#define FISHBED_PLANT_BOARD_STATUS_BYTES 33

typedef struct {
    uint64_t board_time_us; /* µs; board's clock since its reset */
    uint32_t samples; /* taken */
    uint32_t missing; /* numbers passed over */
    uint32_t repeated; /* not newer than the one before, dropped */
    uint16_t stalls; /* times without a sample for stale_after_us */
    uint32_t pulses; /* of the servo output */
    uint32_t nmea_characters; /* given to the UART */
    uint32_t nmea_late; /* after their time, or too late for use */
} fishbed_plant_board_status;

static inline uint8_t fishbed_plant_encode_board_status(const fishbed_plant_board_status *message,
                                                        uint8_t *payload)
{
    if (message->board_time_us > UINT64_C(281474976710655)) {
        return 0;
    }
    payload[0] = FISHBED_PLANT_BOARD_STATUS_ID;
    fishbed_put(payload + 1, message->board_time_us, 6);
    fishbed_put_u32(payload + 7, message->samples);
    fishbed_put_u32(payload + 11, message->missing);
    fishbed_put_u32(payload + 15, message->repeated);
    fishbed_put_u16(payload + 19, message->stalls);
    fishbed_put_u32(payload + 21, message->pulses);
    fishbed_put_u32(payload + 25, message->nmea_characters);
    fishbed_put_u32(payload + 29, message->nmea_late);
    return FISHBED_PLANT_BOARD_STATUS_BYTES;
}

static inline uint8_t fishbed_plant_decode_board_status(fishbed_plant_board_status *message,
                                                        const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_PLANT_BOARD_STATUS_BYTES || payload[0] != FISHBED_PLANT_BOARD_STATUS_ID) {
        return 0;
    }
    message->board_time_us = fishbed_get(payload + 1, 6);
    message->samples = fishbed_get_u32(payload + 7);
    message->missing = fishbed_get_u32(payload + 11);
    message->repeated = fishbed_get_u32(payload + 15);
    message->stalls = fishbed_get_u16(payload + 19);
    message->pulses = fishbed_get_u32(payload + 21);
    message->nmea_characters = fishbed_get_u32(payload + 25);
    message->nmea_late = fishbed_get_u32(payload + 29);
    if (message->board_time_us > UINT64_C(281474976710655)) {
        return 0;
    }
    return 1;
}

/* The table itself. */
#define FISHBED_PLANT_TABLE_VERSION 1

/* Bits of a sample's status. */
#define FISHBED_PLANT_SAMPLE_STATUS_SUPPLY_ON 1
#define FISHBED_PLANT_SAMPLE_STATUS_ACCELEROMETER_NEW 2
#define FISHBED_PLANT_SAMPLE_STATUS_MAGNETOMETER_NEW 4
#define FISHBED_PLANT_SAMPLE_STATUS_LATE 8

/* Whether a payload is a message that the master sends: a fishbed_validator. */
static inline uint8_t fishbed_plant_from_master(const uint8_t *payload, uint8_t length)
{
    if (length == 0) {
        return 0;
    }
    switch (payload[0]) {
    case FISHBED_PLANT_HOST_GREETING_ID: {
        fishbed_plant_host_greeting message;
        return fishbed_plant_decode_host_greeting(&message, payload, length);
    }
    case FISHBED_PLANT_SENSOR_SAMPLE_ID: {
        fishbed_plant_sensor_sample message;
        return fishbed_plant_decode_sensor_sample(&message, payload, length);
    }
    case FISHBED_PLANT_NMEA_CHARACTERS_ID: {
        fishbed_plant_nmea_characters message;
        return fishbed_plant_decode_nmea_characters(&message, payload, length);
    }
    case FISHBED_PLANT_GPS_PULSE_ID: {
        fishbed_plant_gps_pulse message;
        return fishbed_plant_decode_gps_pulse(&message, payload, length);
    }
    default:
        return 0;
    }
}

/* Whether a payload is a message that the slave sends: a fishbed_validator. */
static inline uint8_t fishbed_plant_from_slave(const uint8_t *payload, uint8_t length)
{
    if (length == 0) {
        return 0;
    }
    switch (payload[0]) {
    case FISHBED_PLANT_BOARD_GREETING_ID: {
        fishbed_plant_board_greeting message;
        return fishbed_plant_decode_board_greeting(&message, payload, length);
    }
    case FISHBED_PLANT_SERVO_PULSE_ID: {
        fishbed_plant_servo_pulse message;
        return fishbed_plant_decode_servo_pulse(&message, payload, length);
    }
    case FISHBED_PLANT_REGISTER_WRITE_ID: {
        fishbed_plant_register_write message;
        return fishbed_plant_decode_register_write(&message, payload, length);
    }
    case FISHBED_PLANT_BOARD_STATUS_ID: {
        fishbed_plant_board_status message;
        return fishbed_plant_decode_board_status(&message, payload, length);
    }
    default:
        return 0;
    }
}

#endif
