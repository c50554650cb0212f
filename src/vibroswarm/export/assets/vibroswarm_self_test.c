
/* A short inspection with invented readings: those of export/self_test.py of vibroswarm, of which the numbers above are. */
#include <string.h>

#include "vibroswarm.h"
#include "vibroswarm_parameters.h"

static bool is_near(vs_real found, vs_real expected, vs_real tolerance)
{
    return vs_isnan(expected) ? vs_isnan(found) : vs_abs(found - expected) <= tolerance;
}

static void do_period(vs_Robot *r)
{
    const bool turns = r->walk.mode == VS_TURN || r->walk.mode == VS_AVOID;
    const vs_real gyro_deg = turns ? vs_max(vs_min(r->walk.error_deg, 2), -2) : 0;
    const bool samples = vs_step(r, gyro_deg, r->tick % 128 == 127 ? 20 : 1000);
    if (r->walk.mode == VS_STOP) {
        const vs_real shakes = (vs_real)(r->tick % 2 * (r->samples % 2));
        vs_accelerate(r, 0, 0, VS_RMS_THRESHOLD * (8 + 4 * shakes));
    }
    if (samples)
        vs_sample(r, vs_observed(r));
}

static void hear_itself(vs_Robot *r)
{
    uint8_t packet[VS_PACKET_BYTES];
    vs_Message message;
    vs_int sender, number;
    vs_pack(&r->out, 1, r->sent - 1, packet);
    if (vs_unpack(packet, VS_PACKET_BYTES, &message, &sender, &number))
        vs_receive(r, sender, number, &message);
}

bool vs_self_test(vs_Robot *r)
{
    memset(r, 0, sizeof *r);
    vs_start(r, 1, 0, 0);
    while (r->tick < EXPECTED_TICKS) {
        do_period(r);
        while (r->jobs > 0) {
            vs_work(r);
            if (r->sends && VS_WORLD_ROBOTS > 1)
                hear_itself(r);
        }
    }
    const bool walked = r->walk.mode == EXPECTED_MODE && r->walk.legs == EXPECTED_LEGS &&
                        r->walk.avoidances == EXPECTED_AVOIDANCES;
    const bool counted = r->samples == EXPECTED_SAMPLES && r->sent == EXPECTED_SENT && r->heard == EXPECTED_HEARD &&
                         r->timers == EXPECTED_TIMERS;
    const bool believes = r->decision == EXPECTED_DECISION && is_near(r->belief, EXPECTED_BELIEF, (vs_real)0.01);
    memset(r, 0, sizeof *r);
    return walked && counted && believes;
}
