/* Frames for firmware: CRC, stuffing, and back; see fishbed_frame.h, and spi_bus/frame.py for its twin.
 *
 * A frame is at most one COBS block, so that both ways work in place: every zero becomes the distance
 * to the next, and back. The CRC goes byte by byte without a table, which would cost 512 bytes of
 * flash.
 */
#include "fishbed_frame.h"

#define RESIDUE 0xE2F0u /* CRC of anything with its own CRC behind it */
#define LONGEST_STUFFED 255u
#define SHORTEST_STUFFED (FISHBED_HEADER_BYTES + FISHBED_CRC_BYTES + 1)

uint16_t fishbed_crc16(const uint8_t *data, uint16_t length)
{
    uint16_t crc = 0xFFFFu;

    while (length--) { /* a byte at a time without a table: x^16 + x^12 + x^5 + 1 */
        crc = (uint16_t)((crc >> 8) | (crc << 8));
        crc = (uint16_t)(crc ^ *data++);
        crc = (uint16_t)(crc ^ ((crc & 0xFFu) >> 4));
        crc = (uint16_t)(crc ^ (crc << 12));
        crc = (uint16_t)(crc ^ ((crc & 0xFFu) << 5));
    }
    return (uint16_t)(crc ^ 0xFFFFu);
}

uint16_t fishbed_seal(uint8_t *buffer, uint8_t length)
{
    uint16_t crc = fishbed_crc16(buffer + 1, length);
    uint16_t end = (uint16_t)(length + FISHBED_CRC_BYTES + 1u);
    uint16_t code = 0;
    uint16_t at;

    buffer[end - 2u] = (uint8_t)(crc >> 8);
    buffer[end - 1u] = (uint8_t)(crc & 0xFFu);
    for (at = 1; at < end; at++) {
        if (buffer[at] == 0) { /* every zero becomes the distance to the next */
            buffer[code] = (uint8_t)(at - code);
            code = at;
        }
    }
    buffer[code] = (uint8_t)(end - code);
    buffer[end] = 0;
    return (uint16_t)(end + 1u);
}

uint8_t fishbed_open(uint8_t *buffer, uint16_t length, fishbed_error *error)
{
    uint16_t at = 0;

    if (length < SHORTEST_STUFFED) {
        *error = FISHBED_ERROR_SHORT;
        return 0;
    }
    if (length > LONGEST_STUFFED) {
        *error = FISHBED_ERROR_OVERSIZE;
        return 0;
    }
    do {
        uint8_t code = buffer[at];

        buffer[at] = 0;
        at = (uint16_t)(at + code);
        if (code == 0 || at > length) {
            *error = FISHBED_ERROR_COBS;
            return 0;
        }
    } while (at < length);
    if (fishbed_crc16(buffer + 1, (uint16_t)(length - 1u)) != RESIDUE) {
        *error = FISHBED_ERROR_CRC;
        return 0;
    }
    if (buffer[1] >> 4 != FISHBED_VERSION) {
        *error = FISHBED_ERROR_VERSION;
        return 0;
    }
    return (uint8_t)(length - 1u - FISHBED_CRC_BYTES);
}
