"""The features of a signal in C, as an exporter translates them: a function that writes the numbers of one signal."""

from __future__ import annotations

from typing import Final

from vibroswarm.export.c_functions import Program
from vibroswarm.export.c_types import INT, REAL, CArray, struct_of_class, typedef
from vibroswarm.robot.features import (
    POINTS,
    Band,
    Moments,
    Peak,
    band_coefficient,
    band_energy,
    band_step,
    begin_moments,
    crossings_hz,
    kurtosis,
    moments_step,
    signal_variance,
    spectrum_peak,
)

NUMBERS: Final = ("variance", "kurtosis", "crossings_hz", "band", "peak_hz", "peak_height", "peak_magnitude")
"""What ``call`` writes."""


def features_in_c(precision: int) -> str:
    """Return C with ``call(signal, count, rate, hz, out)``; ``moments``, ``band`` and ``peak`` may be called alone.

    Args:
        precision: 1 single, 3 double.
    """
    structs = {kind: struct_of_class(f"vs_{kind.__name__}", kind) for kind in (Moments, Band, Peak)}
    moments, band, _ = structs.values()
    program = Program(structs, {}, {}, {}, "no template", {})
    wave, spectrum = CArray("vs_stored", (POINTS,)), CArray("vs_stored", (POINTS,))
    made = {
        "begin": program.function(begin_moments, []),
        "step": program.function(moments_step, [moments, REAL]),
        "variance": program.function(signal_variance, [moments]),
        "kurtosis": program.function(kurtosis, [moments]),
        "crossings": program.function(crossings_hz, [moments, REAL]),
        "coefficient": program.function(band_coefficient, [REAL, REAL]),
        "band": program.function(band_step, [band, REAL, REAL]),
        "energy": program.function(band_energy, [band, REAL, INT]),
        "peak": program.function(spectrum_peak, [wave, INT, REAL, spectrum, spectrum]),
    }
    name = {key: item.name for key, item in made.items()}
    lines = [f"#define VS_PRECISION {precision}", '#include "vibroswarm_runtime.h"']
    lines += [typedef(kind) for kind in (*structs.values(), *program.tuples.values())]
    lines += [item.text for item in program.compiled.values() if item is not None]
    lines.append(
        f"""
static vs_stored wave[{POINTS}], re[{POINTS}], im[{POINTS}];
void moments(int32_t count, vs_real rate, double *out) {{
  vs_Moments m = {name["begin"]}();
  for (int32_t i = 0; i < count; i++)
    m = {name["step"]}(&m, wave[i]);
  out[0] = (double){name["variance"]}(&m); out[1] = (double){name["kurtosis"]}(&m);
  out[2] = (double){name["crossings"]}(&m, rate); out[6] = (double)m.largest;
}}
void band(int32_t count, vs_real rate, vs_real hz, double *out) {{
  vs_Band b = {{0, 0}};
  const vs_real c = {name["coefficient"]}(hz, rate);
  for (int32_t i = 0; i < count; i++)
    b = {name["band"]}(&b, c, wave[i]);
  out[3] = (double){name["energy"]}(&b, c, count);
}}
void peak(int32_t count, vs_real rate, double *out) {{
  const vs_Peak p = {name["peak"]}(wave, count, rate, re, im);
  out[4] = (double)p.hz; out[5] = (double)p.height;
}}
void call(const double *signal, int32_t count, double rate, double hz, double *out) {{
  for (int32_t i = 0; i < count; i++)
    wave[i] = (vs_stored)signal[i];
  moments(count, (vs_real)rate, out);
  band(count, (vs_real)rate, (vs_real)hz, out);
  peak(count, (vs_real)rate, out);
}}"""
    )
    return "\n".join(lines)
