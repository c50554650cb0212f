// Robots that fail: how and since when, and the mark they bear.

const faultsOf = new Map(robots.map((robot) => [robot.id, run.faults.filter((fault) => fault.robot === robot.id)]));

// The faults that a robot has at a time, in words.
function faultsAt(robot, t) {
  return faultsOf.get(robot.id).filter((fault) => fault.from_s <= t).map((fault) => fault.fault);
}

// Whether a robot stands for good: it stops after the sample under way, and takes no other.
function standsForGood(robot, pose, t) {
  if (pose.kind !== "stop" || !faultsOf.get(robot.id).some((fault) => fault.stops && fault.from_s <= t)) return false;
  return robot.first === robot.end || latestSample(robot, t) === robot.end - 1;
}

// What a robot does, and what is wrong with it.
function doingWords(robot, pose, t) {
  const doing = standsForGood(robot, pose, t) ? "standing" : stateWord(pose.kind);
  return [doing, ...faultsAt(robot, t)].join(", ");
}

// A cross behind the number: its four ends stick out of the body.
function drawFault(context, x, y, r) {
  for (const [colour, width] of [[colours.panel, 5], [colours.alert, 2.5]]) {
    context.strokeStyle = colour;
    context.lineWidth = width;
    for (const [dx, dy] of [[1, 1], [1, -1], [-1, 1], [-1, -1]]) {
      line(context, x + 0.68 * r * dx, y + 0.68 * r * dy, x + 1.35 * r * dx, y + 1.35 * r * dy);
    }
  }
}
