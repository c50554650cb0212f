/* Smaller sin, cos, tan and erfc than the C library's, for mixed precision (VS_PRECISION 2).

   Those of newlib take 10 kB of flash, half of it for angles that no robot turns.

   | function | relative error, at most | |
   |---|---|---|
   | sine, cosine | 3e-16, up to a million radians | Cody and Waite's reduction, fdlibm's polynomials |
   | tangent | 4e-16, likewise | sine / cosine |
   | erfc | 2e-15 + 2.5e-16 x^2 | t exp(g(t) - x^2), t = 2 / (2 + |x|), g a Chebyshev series |

   Beyond a million radians, an angle's last bits are lost. */
#ifndef VIBROSWARM_MATHEMATICS_H
#define VIBROSWARM_MATHEMATICS_H

#include <math.h>
#include <stdint.h>

/* The sine of an angle and so many right angles. */
static inline double vs_sine_beyond(double x, int64_t right_angles)
{
    static const double of_sine[] = {
        1.58969099521155010221e-10, -2.50507602534068634195e-08, 2.75573137070700676789e-06,
        -1.98412698298579493134e-04, 8.33333333332248946124e-03, -1.66666666666666324348e-01,
    };
    static const double of_cosine[] = {
        -1.13596475577881948265e-11, 2.08757232129817482790e-09, -2.75573143513906633035e-07,
        2.48015872894767294178e-05, -1.38888888888741095749e-03, 4.16666666666666019037e-02,
    };
    if (!(fabs(x) < 1e15))
        return NAN;
    const double turned = floor(x * 0.63661977236758134308 + 0.5);
    /* A right angle in three parts: products with the first two are exact up to a million radians. */
    const double rest = x - turned * 1.57079632673412561417e+00 - turned * 6.07710050630396597660e-11 -
                        turned * 2.02226624879595063154e-21;
    const int quarter = (int)(((int64_t)turned + right_angles) & 3);
    const double squared = rest * rest;
    const double *factors = quarter & 1 ? of_cosine : of_sine;
    double sum = 0.0;
    for (int k = 0; k < 6; k++)
        sum = sum * squared + factors[k];
    sum = quarter & 1 ? 1.0 - (0.5 * squared - squared * squared * sum) : rest + rest * squared * sum;
    return quarter & 2 ? -sum : sum;
}

static inline double vs_small_sin(double x) { return vs_sine_beyond(x, 0); }
static inline double vs_small_cos(double x) { return vs_sine_beyond(x, 1); }
static inline double vs_small_tan(double x) { return vs_sine_beyond(x, 0) / vs_sine_beyond(x, 1); }

static inline double vs_small_erfc(double x)
{
    static const double factors[] = {
        7.1060976136092369878e-15, 3.8109052551892320552e-16, -1.1270822361367252366e-13,
        3.1309213993429580783e-13, 8.9448792730907257167e-13, -6.8860275264975533984e-12,
        2.3940380830391147447e-12, 9.646791102015526802e-11, -2.2736512229318358557e-10,
        -9.9136415649303308674e-10, 5.0593434955514689418e-9, 6.5290544390988514964e-9,
        -8.5238095914926542525e-8, 1.5626441722066143178e-8, 1.3036558355805232018e-6,
        -1.6242900046470255135e-6, -0.000020278578112534243154, 0.000042523324806907771645,
        0.00036683949785276145187, -0.0009465953444820368663, -0.0095615147868086316419,
        0.019476473204185836312, 0.6419697923564902603, -0.65132685989085471710,
    };
    const double far = fabs(x), t = 2.0 / (2.0 + far), argument = 4.0 * t - 2.0;
    double sum = 0.0, before = 0.0;
    for (int k = 0; k < 23; k++) {
        const double next = argument * sum - before + factors[k];
        before = sum;
        sum = next;
    }
    const double beyond = t * exp(0.5 * argument * sum - before + factors[23] - x * x);
    return x < 0.0 ? 2.0 - beyond : beyond;
}

#endif
