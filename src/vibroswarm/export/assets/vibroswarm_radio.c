/* What a robot sends and logs: packets of bytes for messages, and lines that 'vibroswarm lab import' reads. */
#include "vibroswarm.h"
#include "vibroswarm_parameters.h"

static uint8_t *put(uint8_t *to, uint64_t bits, int bytes)
{
    for (int k = 0; k < bytes; k++)
        to[k] = (uint8_t)(bits >> (8 * k));
    return to + bytes;
}

static uint64_t get(const uint8_t **from, int bytes)
{
    uint64_t bits = 0;
    for (int k = 0; k < bytes; k++)
        bits |= (uint64_t)(*from)[k] << (8 * k);
    *from += bytes;
    return bits;
}

vs_int vs_pack(const vs_Message *message, vs_int sender, vs_int number, uint8_t *packet)
{
    uint8_t *to = put(packet, VS_PACKET_VERSION, 1);
    to = put(to, VS_PROGRAM_ID, 4);
    to = put(to, (uint32_t)sender, 1);
    to = put(to, (uint32_t)number, 4);
#define VS_WHOLE(name) to = put(to, (uint32_t)message->name, 4);
#define VS_TRUTH(name) to = put(to, message->name, 1);
#define VS_NUMBER(name) to = put(to, vs_bits(message->name), (int)sizeof(vs_real));
    VS_MESSAGE_FIELDS
#undef VS_WHOLE
#undef VS_TRUTH
#undef VS_NUMBER
    return (vs_int)(to - packet);
}

bool vs_unpack(const uint8_t *packet, vs_int length, vs_Message *message, vs_int *sender, vs_int *number)
{
    const uint8_t *from = packet;
    if (length != VS_PACKET_BYTES || get(&from, 1) != VS_PACKET_VERSION || get(&from, 4) != VS_PROGRAM_ID)
        return false;
    const vs_int from_robot = (vs_int)get(&from, 1);
    if (from_robot >= VS_WORLD_ROBOTS) /* robots are numbered from 0, and the program has memory for these only */
        return false;
    *sender = from_robot;
    *number = (vs_int)(uint32_t)get(&from, 4);
#define VS_WHOLE(name) message->name = (vs_int)(uint32_t)get(&from, 4);
#define VS_TRUTH(name) message->name = get(&from, 1) != 0;
#define VS_NUMBER(name) message->name = vs_of_bits(get(&from, (int)sizeof(vs_real)));
    VS_MESSAGE_FIELDS
#undef VS_WHOLE
#undef VS_TRUTH
#undef VS_NUMBER
    return true;
}

/* A number with so many decimals, and a comma; nothing but the comma for NaN, infinity and what 64 bits do not hold. */
static char *write_number(char *to, vs_real number, int decimals)
{
    char digits[24];
    int count = 0;
    vs_real scaled = vs_abs(number);
    for (int k = 0; k < decimals; k++)
        scaled *= 10;
    if (scaled < VS_R(1e19)) { /* false for NaN too */
        uint64_t whole = (uint64_t)(scaled + (vs_real)0.5);
        if (number < 0 && whole > 0)
            *to++ = '-';
        for (; count <= decimals || whole > 0; whole /= 10)
            digits[count++] = (char)('0' + whole % 10);
        while (count > 0) {
            *to++ = digits[--count];
            if (count == decimals && decimals > 0)
                *to++ = '.';
        }
    }
    *to++ = ',';
    return to;
}

static char *write_whole(char *to, vs_int number) { return write_number(to, (vs_real)number, 0); }

vs_int vs_log_line(const vs_Robot *r, char *line)
{
    char *to = write_whole(line, r->number);
    to = write_number(to, r->sampled_s, 3);
    *to++ = ','; /* x_m, y_m and, below, heading_rad: the robot does not know its place */
    *to++ = ',';
    to = write_number(to, vs_energy(r), 6);
    *to++ = ',';
    to = write_whole(to, vs_observed(r));
    to = write_number(to, r->sends ? VS_LOG_BIT : VS_NAN, 0);
    to = write_number(to, VS_LOG_ALPHA, 0);
    to = write_number(to, VS_LOG_BETA, 0);
    to = write_number(to, r->belief, 6);
    to = write_whole(to, r->decision);
    to = write_whole(to, r->samples - 1); /* the number of this sample, by which lost lines are noticed */
    to = write_whole(to, r->heard);
    *to++ = ','; /* the time spent avoiding is not logged */
    to = write_number(to, (vs_real)r->samples * VS_WALKER_STOP_MS / 1000, 3);
    to[-1] = '\n'; /* the last column has no comma behind it */
    *to = '\0';
    return (vs_int)(to - line);
}
