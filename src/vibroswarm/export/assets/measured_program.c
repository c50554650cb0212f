/* The smallest program around a robot: for measuring flash and static RAM. */
#include "vibroswarm.h"

static vs_Robot robot;
volatile vs_real input[8];
volatile int32_t output[4];

int main(void)
{
    vs_Message heard = {0};
    vs_start(&robot, (vs_int)input[0], 0, (vs_int)input[1]);
    for (;;) {
        vs_receive(&robot, (vs_int)input[0], (vs_int)input[1], &heard);
        output[0] = vs_looks_now(&robot, input[2]);
        if (vs_step(&robot, input[2], input[3]))
            vs_sample(&robot, vs_observed(&robot));
        vs_accelerate(&robot, input[4], input[5], input[6]);
        output[1] = (int32_t)vs_left_percent(&robot);
        output[2] = (int32_t)vs_right_percent(&robot);
        output[3] = robot.sends ? (int32_t)robot.decision : -2;
    }
}
