/* Feeds one exported robot what it measured and heard in an inspection, and writes what it did.

   Input and output are numbers of 8 bytes: in, the kind of an event and then its arguments; out, rows of OUTPUTS.
   On a computer they are stdin and stdout; on a Cortex-M0 files of its debugger (semihosting).

   With LOG it writes the lines of the log instead. */
#include "vibroswarm.h"

#ifdef __arm__
static int call_debugger(int operation, const void *arguments)
{
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = arguments;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static int file_in, file_out;

static int open_file(const char *name, int length, int mode)
{
    const int arguments[3] = {(int)name, mode, length};
    return call_debugger(0x01, arguments);
}

static void open_files(void)
{
    file_in = open_file("in.bin", 6, 1);
    file_out = open_file("out.bin", 7, 5);
}

static int read_bytes(void *to, int count)
{
    const int arguments[3] = {file_in, (int)to, count};
    return count - call_debugger(0x06, arguments);
}

static void write_bytes(const void *from, int count)
{
    const int arguments[3] = {file_out, (int)from, count};
    call_debugger(0x05, arguments);
}

static void finish(void)
{
    const int closing[1] = {file_out};
    call_debugger(0x02, closing);
    call_debugger(0x18, (const void *)0x20026);
    for (;;) {
    }
}
#else
#include <stdio.h>
#include <stdlib.h>
static void open_files(void) {}
static int read_bytes(void *to, int count) { return (int)fread(to, 1, (size_t)count, stdin); }
static void write_bytes(const void *from, int count) { fwrite(from, 1, (size_t)count, stdout); }
static void finish(void)
{
    fflush(stdout);
    exit(0);
}
#endif

static vs_Robot robot;
static double buffer[64];
static int filled, taken;

static double next(void)
{
    if (taken == filled) {
        filled = read_bytes(buffer, sizeof buffer) / (int)sizeof buffer[0];
        taken = 0;
    }
    if (filled == 0)
        finish();
    return buffer[taken++];
}

static vs_Message message;

static void read_message(void)
{
#define F(name) message.name = next();
    MESSAGE_FIELDS
#undef F
}

/* Kind, tick, sends, decision, belief, heard, and the message. */
static void write_event(double kind)
{
#ifndef LOG
    const double head[] = {kind, (double)robot.tick, robot.sends, (double)robot.decision, robot.belief, (double)robot.heard};
    write_bytes(head, sizeof head);
    const double content[] = {
#define F(name) (double)robot.out.name,
        MESSAGE_FIELDS
#undef F
    };
    write_bytes(content, sizeof content);
#else
    (void)kind;
#endif
}

static void write_walk(void)
{
#ifndef LOG
    const double row[] = {(double)robot.tick, (double)robot.walk.mode, (double)robot.walk.legs,
                          (double)robot.walk.avoidances, robot.walk.leg_ms, robot.walk.error_deg};
    write_bytes(row, sizeof row);
#endif
}

static void write_log(void)
{
#ifdef LOG
    char line[VS_LOG_BYTES];
    const int length = vs_log_line(&robot, line);
    write_bytes(line, length);
#endif
}

static void do_event(void)
{
    const int kind = (int)next();
    double v[3];
    vs_int before, timers;
    switch (kind) {
    case 0: /* start: seed, run, number */
        for (int k = 0; k < 3; k++)
            v[k] = next();
        vs_start(&robot, (int64_t)v[0], (vs_int)v[1], (vs_int)v[2]);
        break;
    case 1: /* step: gyro, ray */
        v[0] = next();
        v[1] = next();
        before = robot.walk.mode + 10 * robot.walk.legs + 1000000 * robot.walk.avoidances;
        timers = robot.timers;
        vs_step(&robot, v[0], v[1]);
        if (before != robot.walk.mode + 10 * robot.walk.legs + 1000000 * robot.walk.avoidances)
            write_walk();
        if (timers != robot.timers)
            write_event(5);
        break;
    case 2: /* sample: reading */
        vs_sample(&robot, (vs_int)next());
        write_event(2);
        write_log();
        break;
    case 3: /* message in the inbox: sender, number, content */
        v[0] = next();
        v[1] = next();
        read_message();
        vs_receive(&robot, (vs_int)v[0], (vs_int)v[1], &message);
        break;
    case 4: /* message heard at this tick: tick, sender, number, content */
        robot.tick = (vs_int)next();
        v[0] = next();
        v[1] = next();
        read_message();
        vs_hear(&robot, (vs_int)v[0], (vs_int)v[1], &message);
        break;
    case 5: /* timer: tick */
        robot.tick = (vs_int)next();
        vs_timer(&robot);
        write_event(5);
        break;
    case 6: /* tick of the next sample */
        robot.tick = (vs_int)next();
        break;
    case 7: /* acceleration: x, y, z */
        for (int k = 0; k < 3; k++)
            v[k] = next();
        vs_accelerate(&robot, v[0], v[1], v[2]);
        break;
    default: /* observation of this stop, as -1 or -2 */
        v[0] = -1.0 - (double)vs_observed(&robot);
        write_bytes(v, sizeof v[0]);
    }
}

int main(void)
{
    open_files();
    for (;;)
        do_event();
}

#ifdef __arm__
extern uint32_t data_from[], data_start[], data_end[], bss_start[], bss_end[], stack_top[];

static void reset(void)
{
    for (uint32_t *to = data_start, *from = data_from; to < data_end;)
        *to++ = *from++;
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
#endif
