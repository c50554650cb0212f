// What the three rays of a robot meet: walls, and the sensing discs of other robots.

function wallDistance(x, y, dx, dy) {
  const toX = dx > 0 ? (run.arena.width_m - x) / dx : dx < 0 ? -x / dx : Infinity;
  const toY = dy > 0 ? (run.arena.height_m - y) / dy : dy < 0 ? -y / dy : Infinity;
  return Math.max(Math.min(toX, toY), 0);
}

function discDistance(x, y, dx, dy, cx, cy, radius) {
  const along = (cx - x) * dx + (cy - y) * dy;
  const aside = (cx - x) * dy - (cy - y) * dx;
  if (along < 0 || Math.abs(aside) > radius) return Infinity;
  return Math.max(along - Math.sqrt(radius * radius - aside * aside), 0);
}

// Rays that meet something within range: start, direction, length (m), and whether that is too near.
function raysOf(index, poses) {
  const body = run.body, own = poses[index];
  const cos = Math.cos(own.heading), sin = Math.sin(own.heading);
  const hits = [];
  for (let i = 0; i < body.ray_angles_rad.length; i++) {
    const side = body.ray_sides_m[i], angle = own.heading + body.ray_angles_rad[i];
    const x = own.x + body.ray_forward_m * cos - side * sin;
    const y = own.y + body.ray_forward_m * sin + side * cos;
    const dx = Math.cos(angle), dy = Math.sin(angle);
    let length = wallDistance(x, y, dx, dy);
    for (let other = 0; other < poses.length; other++) {
      if (other === index || !poses[other]) continue;
      length = Math.min(length, discDistance(x, y, dx, dy, poses[other].x, poses[other].y, body.ray_disc_radius_m));
    }
    if (length < body.ray_range_m) hits.push({ x, y, dx, dy, length, near: length < body.avoidance_threshold_m });
  }
  return hits;
}
