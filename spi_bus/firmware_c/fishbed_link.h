/* The link between the boards for firmware: frames, sequence, acknowledgement, handshake.
 *
 * The same protocol as spi_bus/link.py, byte for byte; docs/link.md has it in words and
 * docs/firmware-c.md says how to take these files into a project. Bytes and the time come in, bytes
 * and events go out: no port, no clock, no memory but the struct, nothing from the C library. C99;
 * an int may have 16 bits.
 *
 * A fishbed_link belongs to one context (the main loop): none of these functions may interrupt
 * another on the same link. Interrupt handlers move bytes to and from rings.
 */
#ifndef FISHBED_LINK_H
#define FISHBED_LINK_H

#include "fishbed_frame.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Sizes: the two that cost RAM. Define others before every inclusion, or with -D. */
#ifndef FISHBED_MAX_PAYLOAD
#define FISHBED_MAX_PAYLOAD 40 /* bytes of the longest message, its number included: 6 to 247 */
#endif
#ifndef FISHBED_QUEUE_LIMIT
#define FISHBED_QUEUE_LIMIT 8 /* messages queued, those in flight included: 1 to 255 */
#endif
#if FISHBED_MAX_PAYLOAD < 6 || FISHBED_MAX_PAYLOAD > 247
#error "FISHBED_MAX_PAYLOAD is outside 6 to 247"
#endif
#if FISHBED_QUEUE_LIMIT < 1 || FISHBED_QUEUE_LIMIT > 255
#error "FISHBED_QUEUE_LIMIT is outside 1 to 255"
#endif

#define FISHBED_MAX_BODY (FISHBED_HEADER_BYTES + FISHBED_MAX_PAYLOAD)
#define FISHBED_MAX_STUFFED (FISHBED_MAX_BODY + FISHBED_CRC_BYTES + 1)
#define FISHBED_MAX_WIRE (FISHBED_MAX_STUFFED + 1)

typedef enum {
    FISHBED_MASTER,
    FISHBED_SLAVE
} fishbed_role;

typedef enum {
    FISHBED_EVENT_MESSAGE,      /* payload, length: the peer's next message, exactly once */
    FISHBED_EVENT_ACKNOWLEDGED, /* token: of a message that will never be sent again */
    FISHBED_EVENT_LINK_UP,      /* peer_epoch: first contact */
    FISHBED_EVENT_PEER_RESET,   /* peer_epoch, previous_epoch, unacknowledged */
    FISHBED_EVENT_ERROR,        /* error: bytes were thrown away */
    FISHBED_EVENT_STREAM        /* payload, length: a message of the peer's stream */
} fishbed_event_kind;

typedef struct {
    fishbed_event_kind kind;
    fishbed_error error;
    const uint8_t *payload; /* inside the link; valid until the handler returns */
    uint8_t length;
    uint8_t unacknowledged; /* messages sent to the earlier incarnation; they are sent again */
    uint16_t token;
    uint16_t peer_epoch;
    uint16_t previous_epoch;
} fishbed_event;

/* Called from within fishbed_receive. It may call fishbed_send, fishbed_send_newest and
 * fishbed_set_receive_window. */
typedef void (*fishbed_handler)(void *context, const fishbed_event *event);

/* Says whether a payload is a message of the peer: fishbed_from_master or fishbed_from_slave of
 * fishbed_messages.h. */
typedef uint8_t (*fishbed_validator)(const uint8_t *payload, uint8_t length);

/* Times in microseconds. The retransmission time must exceed what an acknowledgement takes to come
 * back: the peer's delay, both frames on the wire, on SPI the wait for the master's clock. */
typedef struct {
    uint8_t window; /* messages sent and not acknowledged: 1 to 15 */
    uint32_t ack_delay_us;
    uint32_t retransmit_us;     /* least: else twice the round trip; doubles at every time-out */
    uint32_t retransmit_max_us; /* up to this, at most 2^30 */
} fishbed_config;

#define FISHBED_DEFAULT_CONFIG {4, UINT32_C(10000), UINT32_C(60000), UINT32_C(1000000)}

typedef struct { /* modulo 65536; meanings as in spi_bus.link_types.Statistics */
    uint16_t frames_sent;
    uint16_t frames_received;
    uint16_t messages_sent;
    uint16_t messages_acknowledged;
    uint16_t messages_received;
    uint16_t retransmissions;
    uint16_t duplicates;
    uint16_t gaps;
    uint16_t refused;
    uint16_t stale;
    uint16_t lost;
    uint16_t peer_resets;
    uint16_t streamed;
    uint16_t stream_received;
    uint16_t replaced;
    uint16_t errors[FISHBED_ERROR_KINDS];
} fishbed_statistics;

typedef struct {
    uint32_t first_us;
    uint32_t longest_us;
    uint32_t interval_us;
    uint32_t deadline_us;
    uint8_t running;
} fishbed_timer;

/* Read `statistics` and `token` as you like; leave the rest to the functions. */
typedef struct {
    fishbed_statistics statistics;
    uint16_t token; /* of the last message that fishbed_send took; the first has 1 */
    uint8_t foreign_version;

    fishbed_config config;
    fishbed_handler handler;
    fishbed_validator validator;
    void *context;
    uint32_t now_us;
    uint16_t epoch;
    uint8_t own_flag;

    uint16_t in_length;
    uint8_t oversize;
    uint8_t in[FISHBED_MAX_STUFFED];
    uint16_t out_length;
    uint16_t out_sent;
    uint8_t out[FISHBED_MAX_WIRE];

    uint8_t queue_first;
    uint8_t queue_count;
    uint8_t base; /* sequence number of the queue's first message */
    uint8_t next; /* index in the queue of what is sent next */
    uint8_t high; /* how many of the queue have been sent in this session */
    uint8_t peer_window;
    uint8_t probe;
    uint8_t went_back;
    uint8_t timeouts;
    fishbed_timer data_timer;
    uint8_t newest_length; /* of the stream's newest message, until the line takes it; or 0 */
    uint8_t stream_last;   /* the next turn is a message's, where one waits */
    uint8_t timing; /* whether a round trip is measured: of `timed`, since `timed_us` */
    uint8_t timed;
    uint32_t timed_us;
    uint32_t round_trip_us; /* mean; 0: not known yet */

    uint8_t expected;
    uint8_t receive_window;
    uint8_t unacknowledged;
    uint8_t ack_due;
    uint8_t gap_due;
    uint8_t gap_told;
    uint8_t ack_waits;
    uint32_t ack_deadline_us;

    uint16_t peer_epoch; /* 0: not connected */
    uint16_t candidate_epoch;
    uint16_t hello_to_epoch;
    uint8_t peer_challenge;
    uint8_t candidate_challenge;
    uint8_t hello_to_challenge;
    uint8_t challenge;
    uint8_t session_out;
    uint8_t session_in;
    uint8_t hello_due;
    uint8_t ask;
    fishbed_timer hello_timer;

    uint8_t queue_lengths[FISHBED_QUEUE_LIMIT];
    uint8_t queue[FISHBED_QUEUE_LIMIT][FISHBED_MAX_PAYLOAD];
    uint8_t newest[FISHBED_MAX_PAYLOAD];
} fishbed_link;

/* Begin. `epoch` is the number of this boot, 1 to 65535, different from the last boots': a counter
 * in EEPROM or flash. `validator` and `config` may be null. Returns 1, or 0 where a value is out of
 * its range and the link is not usable. */
uint8_t fishbed_init(fishbed_link *link, fishbed_role role, uint16_t epoch,
                     const fishbed_config *config, fishbed_handler handler, void *context,
                     fishbed_validator validator);

/* Take received bytes: any bytes, split anywhere. */
void fishbed_receive(fishbed_link *link, const uint8_t *data, uint16_t length, uint32_t now_us);

/* Write what goes onto the wire now, at most `room` bytes; returns how many. A frame that is cut
 * goes on at the next call. On SPI fill the rest of the block with zeros, only where fewer than
 * `room` came. With `acknowledge` what was received is acknowledged now, without the delay. */
uint16_t fishbed_data_to_send(fishbed_link *link, uint8_t *out, uint16_t room, uint32_t now_us,
                              uint8_t acknowledge);

/* Whether fishbed_data_to_send has something now: the state of a data-ready line. */
uint8_t fishbed_wants_to_send(const fishbed_link *link);

/* Write when fishbed_handle_timer wants to be called; returns 0 while nothing is waited for. */
uint8_t fishbed_next_deadline(const fishbed_link *link, uint32_t *deadline_us);

/* Do what is due. Early or late calls do no harm, up to 35 minutes; the time wraps at 2^32. */
void fishbed_handle_timer(fishbed_link *link, uint32_t now_us);

/* Queue a payload (of a fishbed_encode_ function). Returns 1, or 0 where the queue is full or the
 * length is 0 or over FISHBED_MAX_PAYLOAD. */
uint8_t fishbed_send(fishbed_link *link, const uint8_t *payload, uint8_t length);

/* Hand over the newest message of this side's stream: it goes with the next frame, once, and is not
 * acknowledged; one that still waited is dropped for it. Returns 1, or 0 where there is no peer or
 * the length is 0 or over FISHBED_MAX_PAYLOAD. */
uint8_t fishbed_send_newest(fishbed_link *link, const uint8_t *payload, uint8_t length);

/* The line was opened again: what was on its way is gone. */
void fishbed_resume(fishbed_link *link, uint32_t now_us);

/* How many messages the application takes at present, 0 to 15; 0 holds the peer off. */
uint8_t fishbed_set_receive_window(fishbed_link *link, uint8_t messages);

#ifdef __cplusplus
}
#endif

#endif
