/* Integers to and from single bytes: alignment, padding, the machine's byte order and the width of int
 * do not matter. The headers of messages use these; _be is the big-endian of TinyOS.
 */
#ifndef FISHBED_BYTES_H
#define FISHBED_BYTES_H

#include <stdint.h>

/* Little-endian. */

static inline void fishbed_put(uint8_t *to, uint64_t value, uint8_t count)
{
    while (count--) {
        *to++ = (uint8_t)(value & 0xFFu);
        value >>= 8;
    }
}

static inline void fishbed_put_u16(uint8_t *to, uint16_t value)
{
    to[0] = (uint8_t)(value & 0xFFu);
    to[1] = (uint8_t)(value >> 8);
}

static inline void fishbed_put_u32(uint8_t *to, uint32_t value)
{
    fishbed_put_u16(to, (uint16_t)(value & 0xFFFFu));
    fishbed_put_u16(to + 2, (uint16_t)(value >> 16));
}

static inline uint64_t fishbed_get(const uint8_t *from, uint8_t count)
{
    uint64_t value = 0;

    while (count--) {
        value = (value << 8) | from[count];
    }
    return value;
}

static inline uint16_t fishbed_get_u16(const uint8_t *from)
{
    return (uint16_t)(from[0] | ((uint16_t)from[1] << 8));
}

static inline uint32_t fishbed_get_u32(const uint8_t *from)
{
    return fishbed_get_u16(from) | ((uint32_t)fishbed_get_u16(from + 2) << 16);
}

/* Big-endian. */

static inline void fishbed_put_be(uint8_t *to, uint64_t value, uint8_t count)
{
    while (count--) {
        to[count] = (uint8_t)(value & 0xFFu);
        value >>= 8;
    }
}

static inline void fishbed_put_be_u16(uint8_t *to, uint16_t value)
{
    to[0] = (uint8_t)(value >> 8);
    to[1] = (uint8_t)(value & 0xFFu);
}

static inline void fishbed_put_be_u32(uint8_t *to, uint32_t value)
{
    fishbed_put_be_u16(to, (uint16_t)(value >> 16));
    fishbed_put_be_u16(to + 2, (uint16_t)(value & 0xFFFFu));
}

static inline uint64_t fishbed_get_be(const uint8_t *from, uint8_t count)
{
    uint64_t value = 0;

    while (count--) {
        value = (value << 8) | *from++;
    }
    return value;
}

static inline uint16_t fishbed_get_be_u16(const uint8_t *from)
{
    return (uint16_t)(((uint16_t)from[0] << 8) | from[1]);
}

static inline uint32_t fishbed_get_be_u32(const uint8_t *from)
{
    return ((uint32_t)fishbed_get_be_u16(from) << 16) | fishbed_get_be_u16(from + 2);
}

/* Two's complement, whatever the machine converts to. */

static inline int8_t fishbed_signed_8(uint8_t value)
{
    return (int8_t)(value & 0x80u ? -(int8_t)(0xFFu - value) - 1 : (int8_t)value);
}

static inline int16_t fishbed_signed_16(uint16_t value)
{
    return (int16_t)(value & 0x8000u ? -(int16_t)(0xFFFFu - value) - 1 : (int16_t)value);
}

static inline int32_t fishbed_signed_32(uint32_t value)
{
    return value & UINT32_C(0x80000000) ? -(int32_t)(UINT32_C(0xFFFFFFFF) - value) - 1
                                        : (int32_t)value;
}

#endif
