// Rigid motions of the plane: poses [x, y, theta], metres and radians, as in the Python package.

export function compose(a, b) {
  const c = Math.cos(a[2]), s = Math.sin(a[2]);
  return [a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], a[2] + b[2]];
}

export function inverse(p) {
  const c = Math.cos(p[2]), s = Math.sin(p[2]);
  return [-c * p[0] - s * p[1], s * p[0] - c * p[1], -p[2]];
}

// What moves points of the frame `pose` into the frame in which it is given.
export function mover(pose) {
  const c = Math.cos(pose[2]), s = Math.sin(pose[2]);
  return (x, y) => [pose[0] + c * x - s * y, pose[1] + s * x + c * y];
}

export const degrees = (radians) => {
  const whole = ((radians * 180 / Math.PI + 180) % 360 + 360) % 360 - 180;
  return Math.round(whole);
};

// Half axes and direction of the ellipse that holds 95 % of a normal distribution with this covariance.
export function ellipse(covariance) {
  const [[a, b], [, d]] = covariance;
  const mean = (a + d) / 2, spread = Math.hypot((a - d) / 2, b);
  const reach = (variance) => Math.sqrt(5.991 * Math.max(0, variance));
  return { major: reach(mean + spread), minor: reach(mean - spread), angle: Math.atan2(2 * b, a - d) / 2 };
}
