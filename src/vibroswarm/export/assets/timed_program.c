/* How long a robot's functions take: a small swarm on one emulated processor, whose clock counts instructions.

   For QEMU's board mps2-an385, whose Cortex-M3 runs the code of a Cortex-M0+ as it is, with memory for a whole swarm.
   Robots drive in an arena and hear each other; rays and floor are rougher than in the simulation. Floating-point
   arithmetic, which takes the time, is in software, so times depend little on the numbers.

   ``export.timing`` gives SECONDS, PERIOD_INSTRUCTIONS, FULL_SPEED_M_S, DRIVE_TRACK_M, TURN_TRACK_M and RADIUS_M. */
#include <stdio.h>
#include <string.h>

#include "vibroswarm.h"
#include "vibroswarm_parameters.h"

#define ROBOTS VS_WORLD_ROBOTS
#define NS_PER_TICK 40 /* of SysTick; an instruction takes 1 ns */

typedef struct {
    double x_m, y_m, heading_rad, turned_deg;
    uint32_t waiting_ns; /* of work that is not done yet */
} Body;

static vs_Robot robots[ROBOTS];
static Body bodies[ROBOTS];
static vs_Message sent[ROBOTS];
static bool sends[ROBOTS];
static uint32_t longest_step, longest_stretch, most_work, longest_wait, since;
static double all_work;

static void reset_clock(void)
{
    *(volatile uint32_t *)0xE000E014 = 0xFFFFFF;
    *(volatile uint32_t *)0xE000E018 = 0;
    *(volatile uint32_t *)0xE000E010 = 5;
}

static uint32_t now(void) { return *(volatile uint32_t *)0xE000E018; }
static uint32_t ns_since(uint32_t then) { return ((then - now()) & 0xFFFFFF) * NS_PER_TICK; }

static void raise(uint32_t *longest, uint32_t ns)
{
    if (ns > *longest)
        *longest = ns;
}

static void end_stretch(void)
{
    raise(&longest_stretch, ns_since(since));
    since = now();
}

void vs_poll(void) { end_stretch(); }

static double to_wall_mm(const Body *body)
{
    const double dx = cos(body->heading_rad), dy = sin(body->heading_rad);
    const double along_x = dx > 0 ? VS_WORLD_WIDTH_M - body->x_m : body->x_m;
    const double along_y = dy > 0 ? VS_WORLD_HEIGHT_M - body->y_m : body->y_m;
    const double to_x = fabs(dx) > 0.05 ? along_x / fabs(dx) : 1e3, to_y = fabs(dy) > 0.05 ? along_y / fabs(dy) : 1e3;
    return 1e3 * ((to_x < to_y ? to_x : to_y) - RADIUS_M);
}

static double ray_mm(int i)
{
    double shortest_mm = to_wall_mm(&bodies[i]);
    for (int j = 0; j < ROBOTS; j++) {
        const double dx = bodies[j].x_m - bodies[i].x_m, dy = bodies[j].y_m - bodies[i].y_m;
        const double ahead = dx * cos(bodies[i].heading_rad) + dy * sin(bodies[i].heading_rad);
        const double away_mm = 1e3 * (sqrt(dx * dx + dy * dy) - 2 * RADIUS_M);
        if (j != i && ahead > 0 && away_mm < shortest_mm)
            shortest_mm = away_mm;
    }
    return shortest_mm > 0 ? shortest_mm : 0;
}

static void move(Body *body, double left_percent, double right_percent, bool drives)
{
    const double left_m = left_percent * 0.01 * FULL_SPEED_M_S * VS_WORLD_TICK_S;
    const double right_m = right_percent * 0.01 * FULL_SPEED_M_S * VS_WORLD_TICK_S;
    const double turn_rad = (right_m - left_m) / (drives ? DRIVE_TRACK_M : TURN_TRACK_M);
    const double x_m = body->x_m + 0.5 * (left_m + right_m) * cos(body->heading_rad);
    const double y_m = body->y_m + 0.5 * (left_m + right_m) * sin(body->heading_rad);
    body->heading_rad += turn_rad;
    body->turned_deg = turn_rad * 57.29577951308232;
    if (x_m > RADIUS_M && x_m < VS_WORLD_WIDTH_M - RADIUS_M && y_m > RADIUS_M && y_m < VS_WORLD_HEIGHT_M - RADIUS_M) {
        body->x_m = x_m;
        body->y_m = y_m;
    }
}

/* A floor in a fixed pattern; every ninth reading is wrong. */
static vs_int reading(const Body *body, int number)
{
    const int column = (int)(body->x_m / VS_WORLD_TILE_WIDTH_M), row = (int)(body->y_m / VS_WORLD_TILE_HEIGHT_M);
    const int place = (column * 7 + row * 11) % 5, is_wrong = number % 9 == 8;
    return VS_WORLD_KINDS > 2 ? (place + is_wrong) % VS_WORLD_KINDS : (place < 2) != is_wrong;
}

static void accelerate(int i)
{
#ifdef VS_LINES_AXIS /* the spectrum of a whole signal is computed where a motor shakes the tile */
    const vs_real shake = VS_RMS_THRESHOLD * (reading(&bodies[i], robots[i].samples) > 0 ? 8 : 0);
    for (int k = 0; k < 1 + (int)(VS_SENSING_RATE_HZ * VS_WORLD_TICK_S); k++)
        vs_accelerate(&robots[i], shake * (k % 2), 0, (vs_real)9.8 + shake * (k % 3));
#else
    vs_accelerate(&robots[i], (vs_real)0.3, (vs_real)0.1, (vs_real)9.8);
#endif
}

static void sample(int i)
{
#ifdef VS_LINES_AXIS
    vs_sample(&robots[i], vs_observed(&robots[i]));
#else
    vs_sample(&robots[i], reading(&bodies[i], robots[i].samples));
#endif
}

/* What must be done in this period: the longest of these delays everything else. */
static bool step(int i)
{
    const uint32_t start = now();
    const bool looks = vs_looks_now(&robots[i], (vs_real)bodies[i].turned_deg);
    const double ray = looks ? ray_mm(i) : 1e6;
    const uint32_t begin = now();
    const bool samples = vs_step(&robots[i], (vs_real)bodies[i].turned_deg, (vs_real)ray);
    const double left = vs_left_percent(&robots[i]), right = vs_right_percent(&robots[i]);
    raise(&longest_step, ns_since(begin) + (looks ? 0 : ((start - begin) & 0xFFFFFF) * NS_PER_TICK));
    move(&bodies[i], left, right, robots[i].walk.mode == VS_DRIVE);
    if (robots[i].walk.mode == VS_STOP)
        accelerate(i);
    if (samples)
        sample(i);
    return samples;
}

static void work(int i)
{
    uint32_t in_period = 0;
    while (robots[i].jobs > 0) {
        const uint32_t start = now();
        since = start;
        vs_work(&robots[i]);
        end_stretch();
        in_period += ns_since(start);
        if (robots[i].sends) {
            sent[i] = robots[i].out;
            sends[i] = true;
        }
    }
    all_work += in_period;
    raise(&most_work, in_period);
    bodies[i].waiting_ns += in_period;
    raise(&longest_wait, bodies[i].waiting_ns);
    bodies[i].waiting_ns -= bodies[i].waiting_ns < PERIOD_INSTRUCTIONS ? bodies[i].waiting_ns : PERIOD_INSTRUCTIONS;
}

static void call_debugger(int operation, const void *argument)
{
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
}

int main(void)
{
    static char text[120];
    const bool passes = vs_self_test(&robots[0]);
    reset_clock();
    for (int i = 0; i < ROBOTS; i++) {
        bodies[i].x_m = VS_WORLD_WIDTH_M * (0.2 + 0.6 * (i % 3) / 3.0);
        bodies[i].y_m = VS_WORLD_HEIGHT_M * (0.2 + 0.6 * (i / 3 % 3) / 3.0);
        bodies[i].heading_rad = i;
        vs_start(&robots[i], 4, 0, i);
    }
    longest_stretch = 0;
    for (int32_t tick = 1; tick * VS_WORLD_TICK_S < SECONDS; tick++) {
        for (int i = 0; i < ROBOTS; i++) {
            step(i);
            work(i);
        }
        for (int i = 0; i < ROBOTS; i++) {
            for (int j = 0; j < ROBOTS && sends[i]; j++)
                if (j != i)
                    vs_receive(&robots[j], i, robots[i].sent - 1, &sent[i]);
            sends[i] = false;
        }
    }
    sprintf(text, "%d %lu %lu %lu %lu %lu\n", passes, (unsigned long)longest_step, (unsigned long)longest_stretch,
            (unsigned long)most_work, (unsigned long)longest_wait, (unsigned long)(all_work / ROBOTS / SECONDS));
    call_debugger(0x04, text);
    call_debugger(0x18, (const void *)0x20026);
    return 0;
}

extern uint32_t bss_start[], bss_end[], stack_top[];

static void reset(void)
{
    for (uint32_t *to = bss_start; to < bss_end;)
        *to++ = 0;
    main();
}

static void fault(void)
{
    for (;;)
        call_debugger(0x18, (const void *)0x20024);
}

__attribute__((section(".vectors"), used)) static const void *vectors[] = {stack_top, reset, fault, fault};
