// The layers of a photograph, drawn on one canvas: the picture, maps of heat, smears, epipolar lines.

const SPACING_PX = 17; // between smears on the screen, at least
const CROWD_PX = 9; // between used smears on the screen
const FAN_LINES = 14;
const FAINT_SHARE = 0.5; // a smear whose sigma exceeds this share of its length is drawn faint
const BACKDROP = "#101114";
const OUTLIER = "rgb(190 190 190)";
const HEAT_ALPHA = 200;
const MOVING = [255, 64, 160];
const UNKNOWN = [150, 160, 175];
const MASK_ALPHA = 150;

/** Draw the layers named in `on` (a Set) as `view` shows them, `ratio` device pixels to a pixel. */
function drawLayers(context, view, photo, on, ratio) {
  const { canvas } = context;
  context.setTransform(1, 0, 0, 1, 0, 0);
  context.fillStyle = BACKDROP;
  context.fillRect(0, 0, canvas.width, canvas.height);
  // units of the photograph's pixels, whose first one spans 0 to 1: its centre, pixel 0, lies at 0.5
  context.setTransform(ratio * view.scale, 0, 0, ratio * view.scale, ratio * view.left, ratio * view.top);
  context.imageSmoothingEnabled = ratio * view.scale < 4;
  context.imageSmoothingQuality = "high";
  if (on.has("photograph")) context.drawImage(photo.picture, 0, 0, photo.width, photo.height);
  context.imageSmoothingEnabled = true;
  if (on.has("sigma")) drawOnGrid(context, photo, once(photo, "sigma", sigmaMap));
  if (on.has("probability") && photo.mask) drawOnGrid(context, photo, once(photo, "probability", probabilityMap));
  if (on.has("mask") && photo.mask) drawMask(context, photo);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.lineCap = "round";
  if (on.has("lines")) drawFan(context, view, photo);
  if (on.has("circles")) drawCircles(context, view, photo);
  if (on.has("smears")) drawSmears(context, view, gridPieces(view, photo));
  if (on.has("inliers")) drawUsed(context, view, photo);
}

/** What is made once for each photograph. */
function once(photo, name, make) {
  photo.maps = photo.maps || {};
  photo.maps[name] = photo.maps[name] || make(photo);
  return photo.maps[name];
}

/** A canvas with a pixel per node, spread so that each lies on its node. */
function drawOnGrid(context, photo, map) {
  const { x0, y0, step, columns, rows } = photo.grid;
  context.save();
  context.beginPath();
  context.rect(0, 0, photo.width, photo.height);
  context.clip();
  context.drawImage(map, x0 + 0.5 - step / 2, y0 + 0.5 - step / 2, columns * step, rows * step);
  context.restore();
}

/** Ends [low, high] of the scale of sigma, pixels: its 2nd and 98th percentiles. */
function sigmaRange(photo) {
  const { values, step } = photo.grid.sigmaPx;
  const inOrder = Float64Array.from(values).sort();
  const [low, high] = [0.02, 0.98].map((share) => inOrder[Math.round(share * (inOrder.length - 1))] * step);
  return [Math.max(low, step), Math.max(high, 1.26 * low, 1.26 * step)];
}

function sigmaMap(photo) {
  const [low, high] = sigmaRange(photo);
  const colours = ramp(VIRIDIS).map((colour) => pixelOf(colour, HEAT_ALPHA));
  const { grid } = photo;
  return painted(grid.columns, grid.rows, (index) => {
    const share = Math.log(Math.max(grid.sigmaPx.at(index), low) / low) / Math.log(high / low);
    return colours[Math.round(255 * Math.min(share, 1))];
  });
}

function probabilityMap(photo) {
  const colours = ramp(MAGMA).map((colour) => pixelOf(colour, HEAT_ALPHA));
  const { values } = photo.mask.probability;
  return painted(photo.grid.columns, photo.grid.rows, (index) => colours[values[index]]);
}

function drawMask(context, photo) {
  const { labels, every } = photo.mask;
  const [rows, columns] = labels.shape;
  context.imageSmoothingEnabled = false;
  context.drawImage(once(photo, "mask", maskMap), 0, 0, columns * every, rows * every);
}

/** Pink where something moves by itself, hatched where motion is unobservable. */
function maskMap(photo) {
  const { values, shape } = photo.mask.labels;
  const [moving, unknown] = [MOVING, UNKNOWN].map((colour) => pixelOf(colour, MASK_ALPHA));
  const hatched = (index) => ((index % shape[1]) + Math.floor(index / shape[1])) % 9 < 3;
  return painted(shape[1], shape[0], (index) => {
    if (values[index] === 1) return moving;
    return values[index] === 2 && hatched(index) ? unknown : 0;
  });
}

/** Nodes from one drawn smear to the next. */
function stride(view, photo) {
  const typical = 0.5 * (photo.medianPx || 0) * view.scale;
  return Math.max(1, Math.ceil(Math.max(SPACING_PX, typical) / (photo.grid.step * view.scale)));
}

/** Smears {ends, faint, bucket} at a spread of nodes that can be seen. */
function gridPieces(view, photo) {
  const every = stride(view, photo);
  const { grid } = photo;
  const first = Math.floor(every / 2);
  const plane = grid.rows * grid.columns;
  const pieces = [];
  for (let row = first; row < grid.rows; row += every) {
    for (let column = first; column < grid.columns; column += every) {
      const point = [grid.x0 + column * grid.step, grid.y0 + row * grid.step];
      if (!view.shows(point)) continue;
      const index = row * grid.columns + column;
      const [dx, dy] = [grid.displacement.at(index), grid.displacement.at(plane + index)];
      const faint = grid.sigmaPx.at(index) > FAINT_SHARE * Math.hypot(dx, dy);
      const ends = [-0.5, 0.5].map((half) => [point[0] + half * dx, point[1] + half * dy]);
      pieces.push({ ends, faint, bucket: bucketOf(dx, dy) });
    }
  }
  return pieces;
}

function drawSmears(context, view, pieces) {
  const certain = pieces.filter((piece) => !piece.faint);
  strokePieces(context, view, certain, 4, "rgb(0 0 0 / 0.55)");
  for (const [list, alpha] of [[pieces.filter((piece) => piece.faint), 0.4], [certain, 1]]) {
    for (let bucket = 0; bucket < HUES; bucket++) {
      strokePieces(context, view, list.filter((piece) => piece.bucket === bucket), 2, hueColour(bucket, alpha));
    }
  }
}

function strokePieces(context, view, pieces, width, colour) {
  context.lineWidth = width;
  context.strokeStyle = colour;
  context.beginPath();
  for (const { ends } of pieces) {
    context.moveTo(...view.toScreen(ends[0]));
    context.lineTo(...view.toScreen(ends[1]));
  }
  context.stroke();
}

/** Circles of the radius by which the photograph is out of focus. */
function drawCircles(context, view, { circles }) {
  for (const [width, colour] of [[3, "rgb(0 0 0 / 0.6)"], [1.3, "rgb(120 235 255)"]]) {
    context.lineWidth = width;
    context.strokeStyle = colour;
    context.beginPath();
    for (const { x, y, radius } of circles) {
      if (!view.shows([x, y])) continue;
      const [left, top] = view.toScreen([x, y]);
      context.moveTo(left + radius * view.scale, top);
      context.arc(left, top, radius * view.scale, 0, 2 * Math.PI);
    }
    context.stroke();
  }
}

/** The smears that were used: outliers grey, inliers in the colour of their orientation, dots at their middles. */
function drawUsed(context, view, photo) {
  const shown = thinned(photo.used.filter((match) => view.shows([match.x, match.y])), view);
  const [inliers, outliers] = [true, false].map((inlier) => shown.filter((match) => match.inlier === inlier));
  strokePieces(context, view, shown, 3, "rgb(0 0 0 / 0.5)");
  strokePieces(context, view, outliers, 1.4, OUTLIER);
  drawDots(context, view, outliers, OUTLIER);
  for (let bucket = 0; bucket < HUES; bucket++) {
    const group = inliers.filter((match) => bucketOf(...difference(match.ends)) === bucket);
    strokePieces(context, view, group, 1.4, hueColour(bucket));
    drawDots(context, view, group, hueColour(bucket));
  }
}

/** The first match in every square of the screen of side CROWD_PX: closer up all are shown. */
function thinned(matches, view) {
  const taken = new Set();
  return matches.filter(({ x, y }) => {
    const square = view.toScreen([x, y]).map((value) => Math.floor(value / CROWD_PX)).join();
    return !taken.has(square) && taken.add(square);
  });
}

function drawDots(context, view, matches, colour) {
  context.fillStyle = colour;
  context.beginPath();
  for (const { x, y } of matches) {
    const [left, top] = view.toScreen([x, y]);
    context.moveTo(left + 2.2, top);
    context.arc(left, top, 2.2, 0, 2 * Math.PI);
  }
  context.fill();
}

function difference([one, other]) {
  return [other[0] - one[0], other[1] - one[1]];
}

/** Epipolar lines of a spread of inliers, and the epipoles. */
function drawFan(context, view, photo) {
  const inliers = photo.used.filter((match) => match.inlier);
  const chosen = once(photo, "fan", () => farthest(inliers.map(({ x, y }) => [x, y]), FAN_LINES));
  const lines = chosen.map((k) => {
    const ends = straightened(photo, inliers[k].ends);
    const [first] = inOrder(ends, orderOf(photo.estimate.F, ends));
    return lineInView2(photo.estimate.F, first);
  });
  const pieces = lines.flatMap((line) => drawnLine(photo, line)).map((ends) => ({ ends }));
  strokePieces(context, view, pieces, 1.2, "rgb(255 255 255 / 0.75)");
  if (!photo.lens) epipolesOf(photo).forEach((epipole) => drawRing(context, view, epipole));
}

/** Both epipoles [x, y] that are not at infinity. */
function epipolesOf(photo) {
  const { F } = photo.estimate;
  return [nullVector(F), nullVector(transposed(F))]
    .filter(([x, y, w]) => Math.abs(w) * 1e4 > Math.hypot(x, y))
    .map(([x, y, w]) => [x / w, y / w]);
}

function drawRing(context, view, point) {
  const [x, y] = view.toScreen(point);
  for (const [width, colour] of [[5, "rgb(0 0 0 / 0.7)"], [2, "white"]]) {
    context.lineWidth = width;
    context.strokeStyle = colour;
    context.beginPath();
    context.arc(x, y, 10, 0, 2 * Math.PI);
    context.stroke();
  }
}
