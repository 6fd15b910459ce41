// Two views: points are [x, y] in pixels, [0, 0] the centre of the top-left pixel; points2^T F points1 = 0.

function times(M, [x, y]) {
  return M.map(([a, b, c]) => a * x + b * y + c);
}

function transposed(M) {
  return M[0].map((_, column) => M.map((row) => row[column]));
}

function cross(u, v) {
  return [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
}

/** Epipolar line in view 2 of a point in view 1: [a, b, c] with a x + b y + c = 0. */
function lineInView2(F, point1) {
  return times(F, point1);
}

function lineInView1(F, point2) {
  return times(transposed(F), point2);
}

/** Squared Sampson distance of an ordered match, squared pixels (Hartley and Zisserman, 11.9). */
function sampson(F, point1, point2) {
  const line2 = lineInView2(F, point1);
  const line1 = lineInView1(F, point2);
  const algebraic = line2[0] * point2[0] + line2[1] * point2[1] + line2[2];
  const gradient = line2[0] ** 2 + line2[1] ** 2 + line1[0] ** 2 + line1[1] ** 2;
  return algebraic ** 2 / Math.max(gradient, 1e-30);
}

/** The better order of two ends under F, and the square root of SErrMin, pixels. */
function orderOf(F, [one, other]) {
  const forward = sampson(F, one, other);
  const backward = sampson(F, other, one);
  return { swapped: backward < forward, errorPx: Math.sqrt(Math.min(forward, backward)) };
}

/** Two ends, the one of view 1 first. */
function inOrder([one, other], order) {
  return order.swapped ? [other, one] : [one, other];
}

/** Homogeneous point e of unit length with M e = 0, for M of rank 2. */
function nullVector(M) {
  const candidates = [cross(M[0], M[1]), cross(M[0], M[2]), cross(M[1], M[2])];
  const size = (v) => Math.hypot(...v);
  const best = candidates.reduce((a, b) => (size(b) > size(a) ? b : a));
  return best.map((value) => value / size(best));
}

/** The part of a line within [left, top, right, bottom]: two points, or null. */
function clipped([a, b, c], [left, top, right, bottom]) {
  const points = [];
  if (b !== 0) points.push(...[left, right].map((x) => [x, -(a * x + c) / b]));
  if (a !== 0) points.push(...[top, bottom].map((y) => [-(b * y + c) / a, y]));
  const slack = 1e-6;
  const inside = points.filter(
    ([x, y]) => x >= left - slack && x <= right + slack && y >= top - slack && y <= bottom + slack,
  );
  if (inside.length < 2) return null;
  const along = ([x, y]) => b * x - a * y;
  inside.sort((p, q) => along(p) - along(q));
  return [inside[0], inside[inside.length - 1]];
}

/** The borders of a photograph, half a pixel outside the centres of its outermost pixels. */
function borders(photo) {
  return [-0.5, -0.5, photo.width - 0.5, photo.height - 0.5];
}

/** Straight pieces [[x, y], [x, y]] of a line of undistorted pixels as the photograph shows it. */
function drawnLine(photo, line) {
  if (photo.lens) return photo.lens.curve(line);
  const piece = clipped(line, borders(photo));
  return piece ? [piece] : [];
}
