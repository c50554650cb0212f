/* An inspection by one robot. Fill in the functions marked STUB for your board; everything else is the simulated program.

   Angles are anticlockwise positive. The period is that of the scenario; acceleration is read at VS_SENSING_RATE_HZ.

   A period that your own functions miss is never made up for: the robot's clock goes on without it. */
#include <vibroswarm.h>
#include <vibroswarm_parameters.h>

static const uint8_t ROBOT_NUMBER = 0; /* from 0, another one on each robot */
static_assert(ROBOT_NUMBER < VS_WORLD_ROBOTS, "robots are numbered from 0");
static const uint32_t SEED = 1;        /* the same on all robots, another one in each inspection */
static const uint32_t PERIOD_US = 1000UL * VS_WORLD_TICK_MS;
static const uint32_t READING_US = (uint32_t)(1e6 / VS_SENSING_RATE_HZ);

static vs_Robot robot;
static uint32_t next_period_us, last_reading_us;
static float turned_deg;

/* STUB: turn rate by the gyro, deg/s. */
static float gyro_deg_s() { return 0.0f; }

/* STUB: shortest of the distance sensors, mm. */
static float shortest_ray_mm() { return 1e6f; }

/* STUB: acceleration, in the unit of the scenario's sensor.rms_threshold. */
static void read_acceleration(float *ax, float *ay, float *az) { *ax = *ay = *az = 0.0f; }

/* STUB: wheel speeds, -100 to 100 % of full speed. */
static void set_wheels(float left_percent, float right_percent)
{
    (void)left_percent;
    (void)right_percent;
}

/* STUB: send a packet to all robots. */
static void radio_send(const uint8_t *packet, int length)
{
    (void)packet;
    (void)length;
}

/* STUB: take the next packet that has come in, at most VS_PACKET_BYTES of it; return its length, 0 if there is none. */
static int radio_receive(uint8_t *packet)
{
    (void)packet;
    return 0;
}

/* STUB: write a line of the log, to a file or to the station; once before, VS_LOG_HEADER. */
static void log_line(const char *line) { (void)line; }

void setup()
{
    vs_start(&robot, SEED, 0, ROBOT_NUMBER);
    next_period_us = last_reading_us = micros();
}

static void read_sensors()
{
    const uint32_t passed_us = micros() - last_reading_us;
    float ax, ay, az;
    if (passed_us < READING_US)
        return;
    last_reading_us += passed_us / READING_US * READING_US;
    read_acceleration(&ax, &ay, &az);
    vs_accelerate(&robot, ax, ay, az);
    turned_deg += gyro_deg_s() * 1e-6f * (passed_us / READING_US * READING_US);
}

static void send_message()
{
    uint8_t packet[VS_PACKET_BYTES];
    if (robot.sends)
        radio_send(packet, vs_pack(&robot.out, ROBOT_NUMBER, robot.sent - 1, packet));
}

static void do_period()
{
    const int32_t late_us = (int32_t)(micros() - next_period_us);
    if (late_us < 0)
        return;
    const uint32_t missed = (uint32_t)late_us / PERIOD_US;
    next_period_us += (missed + 1) * PERIOD_US;
    vs_missed(&robot, (vs_int)missed);
    const bool samples = vs_step(&robot, turned_deg, vs_looks_now(&robot, turned_deg) ? shortest_ray_mm() : 1e6f);
    set_wheels(vs_left_percent(&robot), vs_right_percent(&robot));
    turned_deg = 0.0f;
    send_message();
    if (samples) {
        char line[VS_LOG_BYTES];
        vs_sample(&robot, vs_observed(&robot));
        send_message();
        vs_log_line(&robot, line);
        log_line(line);
    }
}

void loop()
{
    vs_Message message;
    vs_int sender, number;
    uint8_t packet[VS_PACKET_BYTES];
    while (const int length = radio_receive(packet))
        if (vs_unpack(packet, length, &message, &sender, &number))
            vs_receive(&robot, sender, number, &message);
    read_sensors();
    do_period();
}
