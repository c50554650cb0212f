/* An inspection by one robot. Fill in the functions marked STUB for your board; everything else is the simulated program.

   Angles are anticlockwise positive. The period is that of the scenario; acceleration is read at VS_SENSING_RATE_HZ. */
#include <string.h>

#include <vibroswarm.h>
#include <vibroswarm_parameters.h>

static const uint8_t ROBOT_NUMBER = 0; /* from 0, another one on each robot */
static const uint32_t SEED = 1;        /* the same on all robots, another one in each inspection */

static vs_Robot robot;
static uint32_t next_period_us, next_reading_us;
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

/* STUB: send a message to all robots, with this robot's number and the message's number. */
static void radio_send(const vs_Message *message, uint8_t sender, uint32_t number)
{
    (void)message;
    (void)sender;
    (void)number;
}

/* STUB: take the next message that has come in; false if there is none. */
static bool radio_receive(vs_Message *message, uint8_t *sender, uint32_t *number)
{
    (void)message;
    (void)sender;
    (void)number;
    return false;
}

void setup()
{
    memset(&robot, 0, sizeof robot);
    vs_start(&robot, SEED, 0, ROBOT_NUMBER);
    vs_told_pose(&robot, 0.0f, 0.0f, 0.0f); /* where it is placed: m, m, rad; without effect if it does not localise */
    next_period_us = next_reading_us = micros();
}

void loop()
{
    vs_Message message;
    uint8_t sender;
    uint32_t number;
    const uint32_t reading_us = (uint32_t)(1e6 / VS_SENSING_RATE_HZ);
    while (radio_receive(&message, &sender, &number))
        vs_receive(&robot, sender, number, &message);
    if ((int32_t)(micros() - next_reading_us) >= 0) {
        float ax, ay, az;
        next_reading_us += reading_us;
        read_acceleration(&ax, &ay, &az);
        vs_accelerate(&robot, ax, ay, az);
        turned_deg += gyro_deg_s() * 1e-6f * reading_us;
    }
    if ((int32_t)(micros() - next_period_us) < 0)
        return;
    next_period_us += 1000UL * VS_WORLD_TICK_MS;
    const bool samples = vs_step(&robot, turned_deg, vs_looks_now(&robot, turned_deg) ? shortest_ray_mm() : 1e6f);
    turned_deg = 0.0f;
    if (samples)
        vs_sample(&robot, vs_observed(&robot));
    if (robot.sends)
        radio_send(&robot.out, ROBOT_NUMBER, (uint32_t)(robot.sent - 1));
    set_wheels(vs_left_percent(&robot), vs_right_percent(&robot));
}
