// The smears of a photograph: at the nodes of the grid, and those that were used as matches.

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
  };
  smear.match = matchAt(photo, smear);
  return described(photo, smear);
}

/** The smear of a match; its sigmas are those of the nearest node. */
function smearOfMatch(photo, match) {
  const [dx, dy] = difference(match.ends);
  return described(photo, { ...smearAt(photo, ...nearestNode(photo, [match.x, match.y])), match, x: match.x, y: match.y, dx, dy });
}

/** Ends p - d/2 and p + d/2, length, direction, error under F, label. */
function described(photo, smear) {
  const { x, y, dx, dy } = smear;
  smear.ends = [[x - dx / 2, y - dy / 2], [x + dx / 2, y + dy / 2]];
  smear.lengthPx = Math.hypot(dx, dy);
  const degrees = orientationOf(dx, dy);
  smear.directionDeg = degrees > 90 ? degrees - 180 : degrees;
  smear.order = photo.estimate.F && orderOf(photo.estimate.F, straightened(photo, smear.ends));
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
  const middle = (one, other) => Math.round(one + other) / 2; // centres of cells lie at halves of pixels
  return { k, x: middle(x0, x1), y: middle(y0, y1), ends: [[x0, y0], [x1, y1]], inlier: (flags.values[k] & 1) > 0 };
}

/** All matches, each in the middle of its cell. */
function indexMatches(photo) {
  photo.used = Array.from({ length: photo.matches.count }, (_, k) => matchOf(photo, k));
  photo.matchOfCell = new Map(photo.used.map((match) => [cellOf(photo, match), match]));
}

/** Which cell holds a pixel, counted from that of the first match. */
function cellOf({ used, matches }, { x, y }) {
  return used.length ? [x - used[0].x, y - used[0].y].map((value) => Math.round(value / matches.spacing)).join() : "";
}

/** The match whose cell holds a pixel {x, y}, or null. */
function matchAt(photo, pixel) {
  return photo.matchOfCell.get(cellOf(photo, pixel)) || null;
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
