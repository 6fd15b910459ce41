// The smears of a photograph: at the nodes of the grid, and those that were used as matches.

const CELL_PX = 32; // side of the cell of a match

/** The smear at node (row, column) of the grid. */
function smearAt(photo, row, column) {
  const { grid } = photo;
  const index = row * grid.columns + column;
  const plane = grid.rows * grid.columns;
  const smear = {
    row,
    column,
    x: grid.x0 + column * grid.step,
    y: grid.y0 + row * grid.step,
    dx: grid.displacement.at(index),
    dy: grid.displacement.at(plane + index),
    sigmaPx: grid.sigmaPx.at(index),
    sigmaRad: grid.sigmaRad ? grid.sigmaRad.at(index) : null,
    match: matchAt(photo, grid.x0 + column * grid.step, grid.y0 + row * grid.step),
  };
  return described(photo, smear);
}

/** Ends p - d/2 and p + d/2, length, direction, error under F, label. */
function described(photo, smear) {
  const { x, y, dx, dy } = smear;
  smear.ends = [[x - dx / 2, y - dy / 2], [x + dx / 2, y + dy / 2]];
  smear.lengthPx = Math.hypot(dx, dy);
  const degrees = orientationOf(dx, dy);
  smear.directionDeg = degrees > 90 ? degrees - 180 : degrees;
  smear.order = photo.facts.F && orderOf(photo.facts.F, straightened(photo, smear.ends));
  smear.label = labelAt(photo, smear);
  return smear;
}

function straightened(photo, points) {
  return photo.lens ? points.map((point) => photo.lens.straight(point)) : points;
}

/** Nearest node to a pixel. */
function nearestNode(photo, [x, y]) {
  const { grid } = photo;
  const node = (value, first, count) => Math.min(Math.max(Math.round((value - first) / grid.step), 0), count - 1);
  return [node(y, grid.y0, grid.rows), node(x, grid.x0, grid.columns)];
}

/** Midpoint and ends of match k. */
function matchOf(photo, k) {
  const { ends, count, flags } = photo.matches;
  const [x0, y0, x1, y1] = [0, 1, 2, 3].map((plane) => ends.at(plane * count + k));
  return { k, x: (x0 + x1) / 2, y: (y0 + y1) / 2, ends: [[x0, y0], [x1, y1]], inlier: (flags.values[k] & 1) > 0 };
}

/** All matches. */
function indexMatches(photo) {
  photo.used = Array.from({ length: photo.matches.count }, (_, k) => matchOf(photo, k));
}

/** The match in whose cell a point lies. */
function matchAt(photo, x, y) {
  return photo.used.find((match) => Math.max(Math.abs(match.x - x), Math.abs(match.y - y)) <= CELL_PX / 2) || null;
}

/** Static, moving or unobservable, with the probability; null without a mask. */
function labelAt(photo, { x, y, row, column }) {
  const { mask, grid } = photo;
  if (!mask) return null;
  const [rows, columns] = mask.labels.shape;
  const r = Math.min(Math.round(y / mask.every), rows - 1);
  const c = Math.min(Math.round(x / mask.every), columns - 1);
  const name = ["static", "moving", "unobservable"][mask.labels.values[r * columns + c]];
  return { name, probability: mask.probability.at(row * grid.columns + column) };
}

/** Indices of up to `count` points, a central one first, then always the farthest from those chosen. */
function farthest(points, count) {
  if (!points.length) return [];
  const mean = [0, 1].map((axis) => points.reduce((sum, p) => sum + p[axis], 0) / points.length);
  const distance = (p, q) => Math.hypot(p[0] - q[0], p[1] - q[1]);
  let next = points.reduce((best, p, i) => (distance(p, mean) < distance(points[best], mean) ? i : best), 0);
  const chosen = [];
  const nearest = points.map(() => Infinity);
  while (chosen.length < Math.min(count, points.length)) {
    chosen.push(next);
    points.forEach((p, i) => (nearest[i] = Math.min(nearest[i], distance(p, points[chosen[chosen.length - 1]]))));
    next = nearest.reduce((best, value, i) => (value > nearest[best] ? i : best), 0);
  }
  return chosen;
}
