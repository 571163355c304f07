/* The link for firmware; see fishbed_link.h for its use and spi_bus/link.py for its twin.
 *
 * Function by function the Python link, so that the two can be read side by side; the tests run
 * them side by side over a hostile channel and compare every byte. What differs: payloads are
 * queued and not objects, events are calls of a handler at the end of each step (when the state is
 * whole again), times wrap at 2^32, and frames are stuffed and opened in the link's two buffers.
 */
#include "fishbed_link.h"

#define HELLO_PAYLOAD 6
#define PROBE_AFTER_TIMEOUTS 4
#define MAX_WINDOW 15

/* Offsets of the header bytes in a body. */
enum { VERSION_TYPE, SESSION, SEQUENCE, ACKNOWLEDGE, FLAGS_WINDOW };

/* Time and timers. Times are compared by their difference, so that they may wrap. */

static uint8_t is_before(uint32_t a, uint32_t b)
{
    return (uint32_t)(a - b) >= UINT32_C(0x80000000);
}

static void timer_start(fishbed_timer *timer, uint32_t now_us)
{
    timer->running = 1;
    timer->deadline_us = now_us + timer->interval_us;
}

static void timer_stop(fishbed_timer *timer)
{
    timer->running = 0;
    timer->interval_us = timer->first_us;
}

static uint8_t timer_expired(fishbed_timer *timer, uint32_t now_us)
{
    if (!timer->running || is_before(now_us, timer->deadline_us)) {
        return 0;
    }
    timer->interval_us *= 2u; /* at most 2^31 */
    if (timer->interval_us > timer->longest_us) {
        timer->interval_us = timer->longest_us;
    }
    timer_start(timer, now_us);
    return 1;
}

/* Events. */

static fishbed_event event_of(fishbed_event_kind kind)
{
    fishbed_event event;

    event.kind = kind;
    event.error = FISHBED_ERROR_KINDS;
    event.payload = 0;
    event.length = 0;
    event.unacknowledged = 0;
    event.token = 0;
    event.peer_epoch = 0;
    event.previous_epoch = 0;
    return event;
}

static void report_error(fishbed_link *link, fishbed_error error)
{
    fishbed_event event = event_of(FISHBED_EVENT_ERROR);

    event.error = error;
    link->statistics.errors[error]++;
    link->handler(link->context, &event);
}

/* What the application sees. */

static void clear(uint8_t *bytes, uint16_t count)
{
    while (count--) {
        *bytes++ = 0;
    }
}

static void timer_init(fishbed_timer *timer, const fishbed_config *config)
{
    timer->first_us = config->retransmit_us;
    timer->longest_us = config->retransmit_max_us;
    timer_stop(timer);
}

uint8_t fishbed_init(fishbed_link *link, fishbed_role role, uint16_t epoch,
                     const fishbed_config *config, fishbed_handler handler, void *context,
                     fishbed_validator validator)
{
    static const fishbed_config DEFAULTS = FISHBED_DEFAULT_CONFIG;

    if (!config) {
        config = &DEFAULTS;
    }
    if (!epoch || !handler || config->window < 1 || config->window > MAX_WINDOW ||
        config->ack_delay_us >= config->retransmit_us ||
        config->retransmit_us > config->retransmit_max_us ||
        config->retransmit_max_us > UINT32_C(0x40000000)) {
        return 0;
    }
    clear((uint8_t *)link, (uint16_t)sizeof *link);
    link->config = *config;
    link->handler = handler;
    link->context = context;
    link->validator = validator;
    link->epoch = epoch;
    link->own_flag = role == FISHBED_SLAVE ? FISHBED_FROM_SLAVE : 0;
    link->receive_window = config->window;
    link->peer_window = 1;
    link->hello_due = 1;
    timer_init(&link->data_timer, config);
    timer_init(&link->hello_timer, config);
    return 1;
}

uint8_t fishbed_set_receive_window(fishbed_link *link, uint8_t messages)
{
    if (messages > MAX_WINDOW) {
        return 0;
    }
    if (messages && !link->receive_window) {
        link->ack_due = link->peer_epoch != 0; /* the peer waits for this */
    }
    link->receive_window = messages;
    return 1;
}

uint8_t fishbed_send(fishbed_link *link, const uint8_t *payload, uint8_t length)
{
    uint8_t slot;
    uint8_t i;

    if (link->queue_count >= FISHBED_QUEUE_LIMIT || !length || length > FISHBED_MAX_PAYLOAD) {
        return 0;
    }
    slot = (uint8_t)(((uint16_t)link->queue_first + link->queue_count) % FISHBED_QUEUE_LIMIT);
    for (i = 0; i < length; i++) {
        link->queue[slot][i] = payload[i];
    }
    link->queue_lengths[slot] = length;
    link->queue_count++;
    link->token++;
    link->statistics.messages_sent++;
    if (!link->peer_window && !link->data_timer.running) {
        timer_start(&link->data_timer, link->now_us);
    }
    return 1;
}

static void drop_newest(fishbed_link *link)
{
    if (link->newest_length) {
        link->newest_length = 0;
        link->statistics.replaced++;
    }
}

uint8_t fishbed_send_newest(fishbed_link *link, const uint8_t *payload, uint8_t length)
{
    uint8_t i;

    if (!link->peer_epoch || !length || length > FISHBED_MAX_PAYLOAD) {
        return 0;
    }
    drop_newest(link);
    for (i = 0; i < length; i++) {
        link->newest[i] = payload[i];
    }
    link->newest_length = length;
    return 1;
}

/* Sending. */

static uint8_t sendable(const fishbed_link *link)
{
    uint8_t window = link->config.window;

    if (!link->peer_epoch || link->next >= link->queue_count) {
        return 0;
    }
    if (link->peer_window < window) {
        window = link->peer_window;
    }
    return link->next < window || (link->probe && !link->next);
}

static uint8_t session(uint16_t from_epoch, uint16_t to_epoch)
{
    return (uint8_t)(((from_epoch & 15u) << 4) | (to_epoch & 15u));
}

static void put_frame(fishbed_link *link, uint8_t type, uint8_t session_byte, uint8_t sequence,
                      uint8_t acknowledge, uint8_t flags, const uint8_t *payload, uint8_t length)
{
    uint8_t *body = link->out + 1;
    uint8_t i;

    body[VERSION_TYPE] = (uint8_t)((FISHBED_VERSION << 4) | type);
    body[SESSION] = session_byte;
    body[SEQUENCE] = sequence;
    body[ACKNOWLEDGE] = acknowledge;
    body[FLAGS_WINDOW] = (uint8_t)(flags | link->own_flag | link->receive_window);
    for (i = 0; i < length; i++) {
        body[FISHBED_HEADER_BYTES + i] = payload[i];
    }
    link->out_length = fishbed_seal(link->out, (uint8_t)(FISHBED_HEADER_BYTES + length));
    link->out_sent = 0;
    link->statistics.frames_sent++;
}

static void put_session_frame(fishbed_link *link, uint8_t type, uint8_t index,
                              const uint8_t *payload, uint8_t length)
{
    uint8_t flags = link->gap_due ? FISHBED_GAP : 0;

    link->gap_due = 0;
    link->ack_due = 0;
    link->ack_waits = 0;
    link->unacknowledged = 0;
    put_frame(link, type, link->session_out, (uint8_t)(link->base + index), link->expected, flags,
              payload, length);
}

static void put_hello(fishbed_link *link, uint32_t now_us)
{
    uint8_t payload[HELLO_PAYLOAD];
    uint8_t flags = 0;
    uint8_t waiting = link->candidate_epoch || !link->peer_epoch;
    uint16_t peer_epoch;
    uint8_t peer_challenge;

    link->hello_due = 0;
    if (waiting || link->ask || link->timeouts >= PROBE_AFTER_TIMEOUTS) {
        flags = FISHBED_REPLY;
    }
    link->ask = 0;
    if (waiting && !link->hello_timer.running) {
        timer_start(&link->hello_timer, now_us);
    }
    if (link->hello_to_epoch) {
        peer_epoch = link->hello_to_epoch;
        peer_challenge = link->hello_to_challenge;
    } else if (link->candidate_epoch) {
        peer_epoch = link->candidate_epoch;
        peer_challenge = link->candidate_challenge;
    } else {
        peer_epoch = link->peer_epoch;
        peer_challenge = link->peer_challenge;
    }
    link->hello_to_epoch = 0;
    payload[0] = (uint8_t)(link->epoch & 0xFFu);
    payload[1] = (uint8_t)(link->epoch >> 8);
    payload[2] = link->challenge;
    payload[3] = (uint8_t)(peer_epoch & 0xFFu);
    payload[4] = (uint8_t)(peer_epoch >> 8);
    payload[5] = peer_challenge;
    put_frame(link, FISHBED_HELLO, session(link->epoch, peer_epoch), 0, 0, flags, payload,
              HELLO_PAYLOAD);
}

static uint8_t put_next_frame(fishbed_link *link, uint32_t now_us)
{
    if (link->hello_due) {
        put_hello(link, now_us);
        return 1;
    }
    if (link->newest_length && !(link->stream_last && sendable(link))) {
        uint8_t length = link->newest_length;

        link->newest_length = 0;
        link->stream_last = 1;
        link->statistics.streamed++;
        put_session_frame(link, FISHBED_STREAM, link->high, link->newest, length);
        return 1;
    }
    link->stream_last = 0;
    if (sendable(link)) {
        uint8_t index = link->next++;
        uint8_t slot = (uint8_t)(((uint16_t)link->queue_first + index) % FISHBED_QUEUE_LIMIT);

        link->probe = 0;
        if (index < link->high) {
            link->statistics.retransmissions++;
        } else {
            link->high = link->next;
            if (!link->timing) {
                link->timing = 1;
                link->timed = (uint8_t)(link->base + index);
                link->timed_us = now_us;
            }
        }
        if (!link->data_timer.running) {
            timer_start(&link->data_timer, now_us);
        }
        put_session_frame(link, FISHBED_DATA, index, link->queue[slot], link->queue_lengths[slot]);
    } else if (link->ack_due) {
        put_session_frame(link, FISHBED_ACK, link->high, 0, 0);
    } else {
        return 0;
    }
    return 1;
}

/* What the transport sees. */

uint8_t fishbed_wants_to_send(const fishbed_link *link)
{
    return link->out_sent < link->out_length || link->newest_length || link->hello_due ||
           link->ack_due || sendable(link);
}

uint8_t fishbed_next_deadline(const fishbed_link *link, uint32_t *deadline_us)
{
    uint8_t found = link->data_timer.running;

    *deadline_us = link->data_timer.deadline_us;
    if (link->hello_timer.running &&
        (!found || is_before(link->hello_timer.deadline_us, *deadline_us))) {
        *deadline_us = link->hello_timer.deadline_us;
        found = 1;
    }
    if (link->ack_waits && (!found || is_before(link->ack_deadline_us, *deadline_us))) {
        *deadline_us = link->ack_deadline_us;
        found = 1;
    }
    return found;
}

void fishbed_handle_timer(fishbed_link *link, uint32_t now_us)
{
    link->now_us = now_us;
    if (link->ack_waits && !is_before(now_us, link->ack_deadline_us)) {
        link->ack_waits = 0;
        link->ack_due = 1;
    }
    if (timer_expired(&link->data_timer, now_us)) {
        link->next = 0;
        if (link->timeouts) {
            link->timing = 0; /* one time-out is let pass, or the wait would never become longer */
        }
        link->probe = 1;
        link->went_back = 0;
        if (link->timeouts < PROBE_AFTER_TIMEOUTS) {
            link->timeouts++;
        }
        if (link->timeouts >= PROBE_AFTER_TIMEOUTS) {
            link->hello_due = 1; /* is the peer who it was? */
        }
    }
    if (timer_expired(&link->hello_timer, now_us)) {
        link->hello_due = 1;
    }
}

uint16_t fishbed_data_to_send(fishbed_link *link, uint8_t *out, uint16_t room, uint32_t now_us,
                              uint8_t acknowledge)
{
    uint16_t count = 0;

    link->now_us = now_us;
    if (acknowledge && link->unacknowledged) {
        link->ack_due = 1;
    }
    while (count < room) {
        if (link->out_sent >= link->out_length && !put_next_frame(link, now_us)) {
            break;
        }
        while (count < room && link->out_sent < link->out_length) {
            out[count++] = link->out[link->out_sent++];
        }
    }
    return count;
}

void fishbed_resume(fishbed_link *link, uint32_t now_us)
{
    link->now_us = now_us;
    link->in_length = 0;
    link->oversize = 0;
    link->out[0] = 0; /* a zero first: the peer's decoder is in step whatever it has heard */
    link->out_length = 1;
    link->out_sent = 0;
    drop_newest(link);
    link->hello_due = 1;
    timer_stop(&link->hello_timer);
    if (!link->peer_epoch) {
        return;
    }
    link->ask = 1;
    link->ack_due = 1;
    link->gap_told = link->gap_due = 0;
    link->next = 0;
    link->timing = 0;
    link->went_back = 1;
    timer_stop(&link->data_timer);
    if (link->high || (!link->peer_window && link->queue_count)) {
        timer_start(&link->data_timer, now_us);
    }
}

/* Receiving. */

/* Take the round trip, if the message that is timed is acknowledged now. */
static void measure_round_trip(fishbed_link *link, uint8_t expected, uint32_t now_us)
{
    uint8_t ahead = (uint8_t)(expected - link->timed);
    uint32_t trip_us = now_us - link->timed_us;
    uint32_t longest_us = link->config.retransmit_max_us;

    if (!link->timing || ahead == 0 || ahead > MAX_WINDOW) {
        return;
    }
    link->timing = 0;
    if (trip_us > longest_us) {
        trip_us = longest_us;
    }
    if (link->round_trip_us) {
        trip_us = link->round_trip_us - link->round_trip_us / 8u + trip_us / 8u;
    }
    link->round_trip_us = trip_us;
    trip_us *= 2u; /* at most 2^31 */
    if (trip_us < link->config.retransmit_us) {
        trip_us = link->config.retransmit_us;
    }
    if (trip_us > longest_us) {
        trip_us = longest_us;
    }
    link->data_timer.first_us = trip_us;
}

static void receive_acknowledge(fishbed_link *link, const uint8_t *body, uint32_t now_us)
{
    uint8_t count = (uint8_t)(body[ACKNOWLEDGE] - link->base);
    uint8_t window = body[FLAGS_WINDOW] & 0x0Fu;
    uint8_t reopened = window && !link->peer_window;
    uint16_t token = (uint16_t)(link->token - link->queue_count);

    if (count > link->high) {
        return; /* older than what we know already */
    }
    link->peer_window = window;
    if (count) {
        link->queue_first =
            (uint8_t)(((uint16_t)link->queue_first + count) % FISHBED_QUEUE_LIMIT);
        link->queue_count = (uint8_t)(link->queue_count - count);
        link->statistics.messages_acknowledged =
            (uint16_t)(link->statistics.messages_acknowledged + count);
        link->base = body[ACKNOWLEDGE];
        link->high = (uint8_t)(link->high - count);
        link->next = link->next > count ? (uint8_t)(link->next - count) : 0;
        link->went_back = 0;
        measure_round_trip(link, body[ACKNOWLEDGE], now_us);
        link->timeouts = 0;
        timer_stop(&link->data_timer);
        if (link->high) {
            timer_start(&link->data_timer, now_us);
        }
    }
    if (((body[FLAGS_WINDOW] & FISHBED_GAP) || reopened) && link->high && !link->went_back) {
        link->next = 0; /* what was in flight behind the gap or the closed window is gone */
        link->went_back = 1;
        link->timing = 0;
        timer_start(&link->data_timer, now_us);
    }
    if (!window) {
        link->timing = 0; /* the application's time, and not the line's */
        if (link->queue_count && !link->data_timer.running) {
            timer_start(&link->data_timer, now_us); /* the update that opens it may be lost: probe */
        }
    }
    while (count--) {
        fishbed_event event = event_of(FISHBED_EVENT_ACKNOWLEDGED);

        event.token = ++token;
        link->handler(link->context, &event);
    }
}

static void receive_data(fishbed_link *link, const uint8_t *body, uint8_t length, uint32_t now_us)
{
    uint8_t ahead = (uint8_t)(body[SEQUENCE] - link->expected);
    fishbed_event event = event_of(FISHBED_EVENT_MESSAGE);

    if (ahead) {
        link->ack_due = 1;
        if (ahead >= 0x80u) {
            link->statistics.duplicates++;
        } else {
            link->statistics.gaps++;
            if (!link->gap_told) {
                link->gap_told = link->gap_due = 1;
            }
        }
        return;
    }
    if (!link->receive_window) {
        link->statistics.refused++;
        link->ack_due = 1;
        return;
    }
    link->expected++;
    link->gap_told = link->gap_due = 0;
    link->unacknowledged++;
    if (2u * link->unacknowledged >= link->config.window || !link->config.ack_delay_us) {
        link->ack_due = 1;
    } else if (!link->ack_waits) {
        link->ack_waits = 1;
        link->ack_deadline_us = now_us + link->config.ack_delay_us;
    }
    event.payload = body + FISHBED_HEADER_BYTES;
    event.length = (uint8_t)(length - FISHBED_HEADER_BYTES);
    if (link->validator && !link->validator(event.payload, event.length)) {
        link->statistics.lost++; /* acknowledged all the same: again it would be no better */
        report_error(link, FISHBED_ERROR_PAYLOAD);
        return;
    }
    link->statistics.messages_received++;
    link->handler(link->context, &event);
}

static void receive_stream(fishbed_link *link, const uint8_t *body, uint8_t length)
{
    fishbed_event event = event_of(FISHBED_EVENT_STREAM);

    event.payload = body + FISHBED_HEADER_BYTES;
    event.length = (uint8_t)(length - FISHBED_HEADER_BYTES);
    if (link->validator && !link->validator(event.payload, event.length)) {
        report_error(link, FISHBED_ERROR_PAYLOAD);
        return;
    }
    link->statistics.stream_received++;
    link->handler(link->context, &event);
}

static void connect_peer(fishbed_link *link, uint16_t epoch, uint8_t challenge, uint8_t window,
                         uint32_t now_us)
{
    uint16_t previous = link->peer_epoch;
    fishbed_event event = event_of(previous ? FISHBED_EVENT_PEER_RESET : FISHBED_EVENT_LINK_UP);

    event.peer_epoch = epoch;
    event.previous_epoch = previous;
    event.unacknowledged = link->high;
    link->peer_epoch = epoch;
    link->peer_challenge = challenge;
    link->challenge++; /* a proof of life serves once */
    link->candidate_epoch = 0;
    timer_stop(&link->hello_timer);
    link->hello_due = 0;
    link->hello_to_epoch = 0;
    link->session_out = session(link->epoch, epoch);
    link->session_in = session(epoch, link->epoch);
    if (previous) {
        link->statistics.peer_resets++;
    }
    drop_newest(link);
    link->base = link->next = link->high = 0;
    link->peer_window = window;
    link->timing = 0;
    link->probe = link->went_back = 0;
    link->timeouts = 0;
    timer_stop(&link->data_timer);
    if (!window && link->queue_count) {
        timer_start(&link->data_timer, now_us);
    }
    link->expected = 0;
    link->unacknowledged = 0;
    link->ack_due = link->gap_due = link->gap_told = 0;
    link->ack_waits = 0;
    link->handler(link->context, &event);
}

static void answer(fishbed_link *link, uint16_t epoch, uint8_t challenge)
{
    link->hello_due = 1; /* to whoever asked, not to the candidate */
    link->hello_to_epoch = epoch;
    link->hello_to_challenge = challenge;
}

static void receive_hello(fishbed_link *link, const uint8_t *body, uint8_t length, uint32_t now_us)
{
    const uint8_t *payload = body + FISHBED_HEADER_BYTES;
    uint16_t epoch;
    uint16_t our_epoch;
    uint8_t challenge;
    uint8_t alive;

    if (length != FISHBED_HEADER_BYTES + HELLO_PAYLOAD) {
        report_error(link, FISHBED_ERROR_MALFORMED);
        return;
    }
    epoch = (uint16_t)(payload[0] | ((uint16_t)payload[1] << 8));
    challenge = payload[2];
    our_epoch = (uint16_t)(payload[3] | ((uint16_t)payload[4] << 8));
    if (!epoch) {
        report_error(link, FISHBED_ERROR_MALFORMED);
        return;
    }
    alive = our_epoch == link->epoch && payload[5] == link->challenge;
    if (epoch == link->peer_epoch) {
        link->peer_challenge = challenge;
        if (alive && link->candidate_epoch) {
            link->candidate_epoch = 0; /* the other was a ghost */
            timer_stop(&link->hello_timer);
        }
    } else if (alive) {
        connect_peer(link, epoch, challenge, body[FLAGS_WINDOW] & 0x0Fu, now_us);
    } else {
        if (link->candidate_epoch != epoch) {
            link->candidate_epoch = epoch;
            if (link->peer_epoch) {
                link->challenge++; /* echoes of our session must not pass for answers to this */
            }
            timer_stop(&link->hello_timer);
        }
        link->candidate_challenge = challenge;
        answer(link, epoch, challenge);
    }
    if (body[FLAGS_WINDOW] & FISHBED_REPLY) {
        answer(link, epoch, challenge);
    }
}

static void receive_body(fishbed_link *link, const uint8_t *body, uint8_t length, uint32_t now_us)
{
    uint8_t type = body[VERSION_TYPE] & 0x0Fu;

    link->statistics.frames_received++;
    if ((body[FLAGS_WINDOW] & FISHBED_FROM_SLAVE) == link->own_flag) {
        report_error(link, FISHBED_ERROR_ECHO);
    } else if (type == FISHBED_HELLO) {
        receive_hello(link, body, length, now_us);
    } else if (type != FISHBED_DATA && type != FISHBED_ACK && type != FISHBED_STREAM) {
        report_error(link, FISHBED_ERROR_MALFORMED);
    } else if (!link->peer_epoch || body[SESSION] != link->session_in) {
        link->statistics.stale++;
    } else {
        receive_acknowledge(link, body, now_us);
        if (type == FISHBED_DATA) {
            receive_data(link, body, length, now_us);
        } else if (type == FISHBED_STREAM) {
            receive_stream(link, body, length);
        }
    }
}

void fishbed_receive(fishbed_link *link, const uint8_t *data, uint16_t length, uint32_t now_us)
{
    link->now_us = now_us;
    while (length--) {
        uint8_t byte = *data++;

        if (byte) {
            if (link->oversize) {
                continue;
            }
            if (link->in_length < FISHBED_MAX_STUFFED) {
                link->in[link->in_length++] = byte;
            } else {
                link->oversize = 1;
                link->in_length = 0;
                report_error(link, FISHBED_ERROR_OVERSIZE);
            }
        } else if (link->in_length) {
            fishbed_error error = FISHBED_ERROR_KINDS;
            uint8_t body_length = fishbed_open(link->in, link->in_length, &error);

            link->in_length = 0;
            if (body_length) {
                receive_body(link, link->in + 1, body_length, now_us);
            } else {
                if (error == FISHBED_ERROR_VERSION) {
                    link->foreign_version = link->in[1] >> 4;
                }
                report_error(link, error);
            }
        } else {
            link->oversize = 0; /* filler, or the end of what was too long */
        }
    }
}
