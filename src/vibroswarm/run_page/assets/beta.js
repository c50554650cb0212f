// The Beta density, relative to its peak: all that a picture of its shape needs.

function logBeta(alpha, beta, x) {
  const left = alpha === 1 ? 0 : (alpha - 1) * Math.log(x);
  return left + (beta === 1 ? 0 : (beta - 1) * Math.log(1 - x));
}

// Heights between 0 and 1 at n + 1 even steps from low to high.
function betaShape(alpha, beta, low, high, n) {
  const inside = Math.min(Math.max((alpha - 1) / (alpha + beta - 2 || 1), 1e-9), 1 - 1e-9);
  const peak = alpha < 1 || beta < 1 ? logBeta(alpha, beta, 1e-3) : logBeta(alpha, beta, inside);
  const heights = new Float64Array(n + 1);
  for (let i = 0; i <= n; i++) {
    const x = Math.min(Math.max(low + (high - low) * i / n, 1e-9), 1 - 1e-9);
    heights[i] = Math.min(Math.exp(logBeta(alpha, beta, x) - peak), 1);
  }
  return heights;
}

function betaMoments(alpha, beta) {
  const n = alpha + beta;
  return { mean: alpha / n, deviation: Math.sqrt(alpha * beta / (n * n * (n + 1))) };
}

// Half widths of the window around the boundary; one that holds all posteriors and the truth is chosen.
const HALF_WIDTHS = [0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5];

function shapeWindow(minds) {
  const centre = run.rule.tested;
  let reach = Math.abs(run.truth.ones - centre) + 0.01;
  for (const mind of minds) {
    const { mean, deviation } = betaMoments(mind.alpha, mind.beta);
    reach = Math.max(reach, Math.abs(mean - centre) + 3.2 * deviation);
  }
  const half = HALF_WIDTHS.find((width) => width >= reach) ?? 1;
  return { low: Math.max(centre - half, 0), high: Math.min(centre + half, 1) };
}
