/* Messages with their layouts. Made by python -m tools.message_reference from the table in
 * radio_802154/routing_messages.py: change that and not this file. docs/messages.md has them in
         words.
 *
 * Members that end in _raw hold scaled integers: value = raw / ..._LSB_PER_UNIT. A message with
 * optional members has `valid`, a mask of ..._HAS_... bits; a member without its bit is no value.
 *
 * They are active messages of the network layer (docs/network.md), big-endian: the number is the AM
 * type. Behind the fields of some follow entries, or the application's octets, up to 28 octets in
 * all: ..._TAIL says how long one is. Encoders write the fields and return their length; 0 where a
 * member is outside its range, and then the buffer is untouched. Decoders return 1; 0 where the
 * payload is not this message as an encoder makes it, with a whole number of entries behind, and
 * then the struct is undefined. An entry has no number, and a coder of its own.
 */
#ifndef FISHBED_ROUTING_MESSAGES_H
#define FISHBED_ROUTING_MESSAGES_H

#include "fishbed_bytes.h"

#include <stdint.h>

/* Longest payload of the table. */
#define FISHBED_ROUTING_LARGEST_MESSAGE 28

/* Beacon, from the board: a board is there. */
#define FISHBED_ROUTING_BEACON_AM_TYPE 0x30
#define FISHBED_ROUTING_BEACON_BYTES 6
#define FISHBED_ROUTING_BEACON_TAIL 3

typedef struct {
    uint8_t sequence; /* counts the sender's beacons, wraps */
    uint8_t flags; /* see BeaconFlag */
    uint16_t parent; /* next hop to the base; 0xFFFF: none */
    uint16_t etx; /* sixteenths of transmissions to the base; 0xFFFF: no route */
} fishbed_routing_beacon;

static inline uint8_t fishbed_routing_encode_beacon(const fishbed_routing_beacon *message,
                                                    uint8_t *payload)
{
    payload[0] = message->sequence;
    payload[1] = message->flags;
    fishbed_put_be_u16(payload + 2, message->parent);
    fishbed_put_be_u16(payload + 4, message->etx);
    return FISHBED_ROUTING_BEACON_BYTES;
}

static inline uint8_t fishbed_routing_decode_beacon(fishbed_routing_beacon *message,
                                                    const uint8_t *payload, uint8_t length)
{
    if (length < FISHBED_ROUTING_BEACON_BYTES) {
        return 0;
    }
    if ((length - FISHBED_ROUTING_BEACON_BYTES) % FISHBED_ROUTING_BEACON_TAIL != 0) {
        return 0;
    }
    message->sequence = payload[0];
    message->flags = payload[1];
    message->parent = fishbed_get_be_u16(payload + 2);
    message->etx = fishbed_get_be_u16(payload + 4);
    return 1;
}

/* CollectionData, from the board: a record for the base. */
#define FISHBED_ROUTING_COLLECTION_DATA_AM_TYPE 0x31
#define FISHBED_ROUTING_COLLECTION_DATA_BYTES 11
#define FISHBED_ROUTING_COLLECTION_DATA_TAIL 1

typedef struct {
    uint8_t hops; /* boards that have passed it on (THL of TEP 123) */
    uint16_t etx; /* the sender's, when it went */
    uint16_t origin; /* whose record it is */
    uint32_t number; /* of the record in the origin's log, never used again */
    uint8_t repeat; /* how often the origin has begun anew, wraps */
    uint8_t behind; /* number less that of the oldest record not acknowledged */
} fishbed_routing_collection_data;

static inline uint8_t fishbed_routing_encode_collection_data(
        const fishbed_routing_collection_data *message, uint8_t *payload)
{
    payload[0] = message->hops;
    fishbed_put_be_u16(payload + 1, message->etx);
    fishbed_put_be_u16(payload + 3, message->origin);
    fishbed_put_be_u32(payload + 5, message->number);
    payload[9] = message->repeat;
    payload[10] = message->behind;
    return FISHBED_ROUTING_COLLECTION_DATA_BYTES;
}

static inline uint8_t fishbed_routing_decode_collection_data(
        fishbed_routing_collection_data *message, const uint8_t *payload, uint8_t length)
{
    if (length < FISHBED_ROUTING_COLLECTION_DATA_BYTES) {
        return 0;
    }
    message->hops = payload[0];
    message->etx = fishbed_get_be_u16(payload + 1);
    message->origin = fishbed_get_be_u16(payload + 3);
    message->number = fishbed_get_be_u32(payload + 5);
    message->repeat = payload[9];
    message->behind = payload[10];
    return 1;
}

/* CollectionAck, from the board: what the base has of an origin. */
#define FISHBED_ROUTING_COLLECTION_ACK_AM_TYPE 0x32
#define FISHBED_ROUTING_COLLECTION_ACK_BYTES 8

typedef struct {
    uint16_t origin; /* whose records these are */
    uint8_t hops; /* boards that have passed it on */
    uint32_t next; /* all records with lower numbers are at the base */
    uint8_t beyond; /* bit n: record next + 1 + n is there too */
} fishbed_routing_collection_ack;

static inline uint8_t fishbed_routing_encode_collection_ack(
        const fishbed_routing_collection_ack *message, uint8_t *payload)
{
    fishbed_put_be_u16(payload + 0, message->origin);
    payload[2] = message->hops;
    fishbed_put_be_u32(payload + 3, message->next);
    payload[7] = message->beyond;
    return FISHBED_ROUTING_COLLECTION_ACK_BYTES;
}

static inline uint8_t fishbed_routing_decode_collection_ack(
                                                            fishbed_routing_collection_ack *message,
                                                            const uint8_t *payload,
                                                            uint8_t length)
{
    if (length != FISHBED_ROUTING_COLLECTION_ACK_BYTES) {
        return 0;
    }
    message->origin = fishbed_get_be_u16(payload + 0);
    message->hops = payload[2];
    message->next = fishbed_get_be_u32(payload + 3);
    message->beyond = payload[7];
    return 1;
}

/* Versions, from the board: what a board has of the shared items. */
#define FISHBED_ROUTING_VERSIONS_AM_TYPE 0x33
#define FISHBED_ROUTING_VERSIONS_BYTES 4
#define FISHBED_ROUTING_VERSIONS_TAIL 4

typedef struct {
    uint32_t digest; /* sum of the mixed versions, see sharing.py */
} fishbed_routing_versions;

static inline uint8_t fishbed_routing_encode_versions(const fishbed_routing_versions *message,
                                                      uint8_t *payload)
{
    fishbed_put_be_u32(payload + 0, message->digest);
    return FISHBED_ROUTING_VERSIONS_BYTES;
}

static inline uint8_t fishbed_routing_decode_versions(fishbed_routing_versions *message,
                                                      const uint8_t *payload, uint8_t length)
{
    if (length < FISHBED_ROUTING_VERSIONS_BYTES) {
        return 0;
    }
    if ((length - FISHBED_ROUTING_VERSIONS_BYTES) % FISHBED_ROUTING_VERSIONS_TAIL != 0) {
        return 0;
    }
    message->digest = fishbed_get_be_u32(payload + 0);
    return 1;
}

/* SharedItem, from the board: an item for everybody. */
#define FISHBED_ROUTING_SHARED_ITEM_AM_TYPE 0x34
#define FISHBED_ROUTING_SHARED_ITEM_BYTES 4
#define FISHBED_ROUTING_SHARED_ITEM_TAIL 1

typedef struct {
    uint16_t origin; /* whose item */
    uint16_t number; /* from 1, without gaps */
} fishbed_routing_shared_item;

static inline uint8_t fishbed_routing_encode_shared_item(
                                                         const fishbed_routing_shared_item *message,
                                                         uint8_t *payload)
{
    fishbed_put_be_u16(payload + 0, message->origin);
    fishbed_put_be_u16(payload + 2, message->number);
    return FISHBED_ROUTING_SHARED_ITEM_BYTES;
}

static inline uint8_t fishbed_routing_decode_shared_item(fishbed_routing_shared_item *message,
                                                         const uint8_t *payload, uint8_t length)
{
    if (length < FISHBED_ROUTING_SHARED_ITEM_BYTES) {
        return 0;
    }
    message->origin = fishbed_get_be_u16(payload + 0);
    message->number = fishbed_get_be_u16(payload + 2);
    return 1;
}

/* TimeMark, from the board: the root's time. */
#define FISHBED_ROUTING_TIME_MARK_AM_TYPE 0x35
#define FISHBED_ROUTING_TIME_MARK_BYTES 7

typedef struct {
    uint16_t root; /* whose time it is */
    uint8_t sequence; /* the root counts, wraps */
    uint32_t time; /* ticks of 1/32768 s, wraps after 36 h */
} fishbed_routing_time_mark;

static inline uint8_t fishbed_routing_encode_time_mark(const fishbed_routing_time_mark *message,
                                                       uint8_t *payload)
{
    fishbed_put_be_u16(payload + 0, message->root);
    payload[2] = message->sequence;
    fishbed_put_be_u32(payload + 3, message->time);
    return FISHBED_ROUTING_TIME_MARK_BYTES;
}

static inline uint8_t fishbed_routing_decode_time_mark(fishbed_routing_time_mark *message,
                                                       const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_ROUTING_TIME_MARK_BYTES) {
        return 0;
    }
    message->root = fishbed_get_be_u16(payload + 0);
    message->sequence = payload[2];
    message->time = fishbed_get_be_u32(payload + 3);
    return 1;
}

/* LinkQuality, from the board: follows a Beacon's fields, up to 7 times. */
#define FISHBED_ROUTING_LINK_QUALITY_BYTES 3

typedef struct {
    uint16_t neighbour; /* address */
    uint8_t inbound; /* share of its beacons that arrive, of 255 */
} fishbed_routing_link_quality;

static inline uint8_t fishbed_routing_encode_link_quality(
        const fishbed_routing_link_quality *message, uint8_t *payload)
{
    fishbed_put_be_u16(payload + 0, message->neighbour);
    payload[2] = message->inbound;
    return FISHBED_ROUTING_LINK_QUALITY_BYTES;
}

static inline uint8_t fishbed_routing_decode_link_quality(fishbed_routing_link_quality *message,
                                                          const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_ROUTING_LINK_QUALITY_BYTES) {
        return 0;
    }
    message->neighbour = fishbed_get_be_u16(payload + 0);
    message->inbound = payload[2];
    return 1;
}

/* Version, from the board: follows a Versions' digest, up to 6 times. */
#define FISHBED_ROUTING_VERSION_BYTES 4

typedef struct {
    uint16_t origin; /* whose items */
    uint16_t number; /* all up to this one; 0: none */
} fishbed_routing_version;

static inline uint8_t fishbed_routing_encode_version(const fishbed_routing_version *message,
                                                     uint8_t *payload)
{
    fishbed_put_be_u16(payload + 0, message->origin);
    fishbed_put_be_u16(payload + 2, message->number);
    return FISHBED_ROUTING_VERSION_BYTES;
}

static inline uint8_t fishbed_routing_decode_version(fishbed_routing_version *message,
                                                     const uint8_t *payload, uint8_t length)
{
    if (length != FISHBED_ROUTING_VERSION_BYTES) {
        return 0;
    }
    message->origin = fishbed_get_be_u16(payload + 0);
    message->number = fishbed_get_be_u16(payload + 2);
    return 1;
}

/* Flags of a Beacon. */
#define FISHBED_ROUTING_BEACON_FLAG_PULL 1

/* Whether a payload is a message that the board sends. */
static inline uint8_t fishbed_routing_from_board(uint8_t am_type, const uint8_t *payload,
                                                 uint8_t length)
{
    switch (am_type) {
    case FISHBED_ROUTING_BEACON_AM_TYPE: {
        fishbed_routing_beacon message;
        return fishbed_routing_decode_beacon(&message, payload, length);
    }
    case FISHBED_ROUTING_COLLECTION_DATA_AM_TYPE: {
        fishbed_routing_collection_data message;
        return fishbed_routing_decode_collection_data(&message, payload, length);
    }
    case FISHBED_ROUTING_COLLECTION_ACK_AM_TYPE: {
        fishbed_routing_collection_ack message;
        return fishbed_routing_decode_collection_ack(&message, payload, length);
    }
    case FISHBED_ROUTING_VERSIONS_AM_TYPE: {
        fishbed_routing_versions message;
        return fishbed_routing_decode_versions(&message, payload, length);
    }
    case FISHBED_ROUTING_SHARED_ITEM_AM_TYPE: {
        fishbed_routing_shared_item message;
        return fishbed_routing_decode_shared_item(&message, payload, length);
    }
    case FISHBED_ROUTING_TIME_MARK_AM_TYPE: {
        fishbed_routing_time_mark message;
        return fishbed_routing_decode_time_mark(&message, payload, length);
    }
    default:
        return 0;
    }
}

#endif
