/* Frames of the link between the boards: header, payload, CRC, stuffed by COBS, closed by a zero.
 *
 * For firmware that speaks the whole protocol fishbed_link.h is enough; these are for a probe, a
 * bootloader, or a bridge that passes frames on. docs/link.md has the bytes. Nothing from the C
 * library, no state; an int may have 16 bits.
 */
#ifndef FISHBED_FRAME_H
#define FISHBED_FRAME_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define FISHBED_VERSION 1
#define FISHBED_HEADER_BYTES 5
#define FISHBED_CRC_BYTES 2

/* Frame types (low nibble of byte 0) and flags (high nibble of byte 4). */
#define FISHBED_HELLO 1
#define FISHBED_DATA 2
#define FISHBED_ACK 3
#define FISHBED_STREAM 4
#define FISHBED_FROM_SLAVE 0x10
#define FISHBED_GAP 0x20
#define FISHBED_REPLY 0x40

/* What was wrong with received bytes; the order is that of spi_bus.frame.ErrorKind. */
typedef enum {
    FISHBED_ERROR_COBS,
    FISHBED_ERROR_SHORT,
    FISHBED_ERROR_OVERSIZE, /* longer than a frame, or than FISHBED_MAX_PAYLOAD allows */
    FISHBED_ERROR_CRC,
    FISHBED_ERROR_VERSION,
    FISHBED_ERROR_MALFORMED,
    FISHBED_ERROR_ECHO,
    FISHBED_ERROR_PAYLOAD, /* no message of the table; acknowledged and dropped */
    FISHBED_ERROR_KINDS
} fishbed_error;

/* CRC-16/GENIBUS; 0xD64E for "123456789". */
uint16_t fishbed_crc16(const uint8_t *data, uint16_t length);

/* Turn the `length` bytes (header and payload, 1 to 252) at buffer + 1 into a frame at buffer, in
 * place: CRC, stuffing, closing zero. Returns length + 4, the bytes on the wire. */
uint16_t fishbed_seal(uint8_t *buffer, uint8_t length);

/* Turn the `length` bytes before a closing zero into header and payload at buffer + 1, in place.
 * Returns their length; 0 where the frame is damaged, with the reason. */
uint8_t fishbed_open(uint8_t *buffer, uint16_t length, fishbed_error *error);

#ifdef __cplusplus
}
#endif

#endif
