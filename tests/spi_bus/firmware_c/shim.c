/* The C link as Python calls it: links on the heap, events as a list of plain records. */
#include <stdlib.h>
#include <string.h>

#include "fishbed_link.h"
#include "fishbed_messages.h"

typedef struct {
    uint8_t kind, error, length, unacknowledged;
    uint16_t token, peer_epoch, previous_epoch;
    uint8_t payload[FISHBED_MAX_PAYLOAD];
} record;

typedef struct {
    fishbed_link link;
    uint32_t count;
    record records[4096];
} shim;

static void on_event(void *context, const fishbed_event *event)
{
    shim *self = context;
    record *to = &self->records[self->count++ % 4096];

    to->kind = (uint8_t)event->kind;
    to->error = (uint8_t)event->error;
    to->length = event->length;
    to->unacknowledged = event->unacknowledged;
    to->token = event->token;
    to->peer_epoch = event->peer_epoch;
    to->previous_epoch = event->previous_epoch;
    if (event->length) {
        memcpy(to->payload, event->payload, event->length);
    }
}

shim *shim_new(int slave, uint16_t epoch, const fishbed_config *config)
{
    shim *self = malloc(sizeof *self);

    memset(self, 0x5A, sizeof *self); /* RAM after a reset holds anything */
    self->count = 0;
    if (!fishbed_init(&self->link, slave ? FISHBED_SLAVE : FISHBED_MASTER, epoch, config, on_event,
                      self, slave ? fishbed_from_master : fishbed_from_slave)) {
        free(self);
        return 0;
    }
    return self;
}

void shim_free(shim *self)
{
    free(self);
}

uint32_t shim_receive(shim *self, const uint8_t *data, uint16_t length, uint32_t now_us)
{
    self->count = 0;
    fishbed_receive(&self->link, data, length, now_us);
    return self->count;
}

const record *shim_record(const shim *self, uint32_t index)
{
    return &self->records[index];
}

uint16_t shim_state(const shim *self, int what)
{
    const fishbed_link *link = &self->link;
    const uint16_t values[] = {link->queue_count, link->peer_epoch, link->token,
                               link->foreign_version, link->receive_window};
    return values[what];
}

const uint16_t *shim_statistics(const shim *self)
{
    return &self->link.statistics.frames_sent;
}
