// What is written about a photograph: the verdict, the models that competed, F, times, values of a smear.

function byId(id) {
  return document.getElementById(id);
}

/** An element with text and children; text never becomes markup. */
function element(tag, { className = "", text = "", children = [] } = {}) {
  const made = document.createElement(tag);
  if (className) made.className = className;
  if (text) made.textContent = text;
  made.append(...children);
  return made;
}

function showEstimate(photo) {
  const { estimate } = photo;
  const [, folder, base] = /^(.*[\\/])?(.*)$/s.exec(photo.name);
  byId("photo-name").textContent = base;
  byId("photo-folder").textContent = folder || "";
  byId("chip").textContent = estimate.config;
  byId("chip").className = `chip chip-${photo.kind}`;
  byId("meaning").textContent = photo.meaning;
  byId("reason").textContent = estimate.reason;
  byId("ends-note").textContent = estimate.F
    ? "1 is the end of shutter-open and 2 that of shutter-close, or all of them the other way round: one photograph does not show the direction of time."
    : "";
  showPairs(byId("counts"), countsOf(photo));
  showScores(estimate);
  showMatrix(photo);
  showSeconds(photo.seconds);
}

function inliersOf({ F, H, num_inliers: inliers, num_matches: matches }) {
  if (!F && !H) return "-";
  return F && H ? `${inliers} of F; H explains them, too` : `${inliers} (${Math.floor((100 * inliers) / matches)} %)`;
}

function countsOf({ estimate, medianPx, lens }) {
  const pairs = [
    ["photograph", `${estimate.width} x ${estimate.height}`],
    ["smears used", estimate.num_matches + (medianPx === null ? "" : `, of median length ${medianPx.toFixed(1)} px`)],
    ["parallax", estimate.parallax],
    ["inliers", inliersOf(estimate)],
    ["network", estimate.model_id],
    ["seed", String(estimate.seed)],
  ];
  if (estimate.rotation_deg !== null) pairs.push(["rotation", rotationOf(estimate, estimate.exposure_s)]);
  if (estimate.backward) pairs.push(["in the other order in time", rotationOf(estimate.backward, estimate.exposure_s)]);
  if (estimate.camera) pairs.push(["camera", `${estimate.camera.model}, ${estimate.camera.source}`]);
  if (lens) pairs.push(["lens", "distorts: epipolar lines are curves"]);
  return pairs;
}

function showPairs(list, pairs) {
  list.replaceChildren(...pairs.flatMap(([name, value]) => [element("dt", { text: name }), element("dd", { text: value })]));
}

/** The angle of a rotation, and the angular velocity where the exposure time is known. */
function rotationOf({ rotation_deg: angle, wx, wy, wz }, seconds) {
  const rate = seconds === null ? "" : `, ${Math.hypot(wx, wy, wz).toPrecision(3)} rad/s in ${seconds} s`;
  return `${angle.toFixed(3)}\u00b0${rate}`;
}

/** A row with a name, a bar for a share of 0 to 1, and a value. */
function bar(name, share, value, chosen = false) {
  const fill = element("span", { className: "bar-fill" });
  fill.style.width = `${Math.max(100 * share, 1)}%`;
  const row = element("li", {
    className: chosen ? "bar bar-chosen" : "bar",
    children: [
      element("span", { className: "bar-name", text: name }),
      element("span", { className: "bar-track", children: [fill] }),
      element("span", { className: "bar-value", text: value }),
    ],
  });
  if (chosen) row.setAttribute("aria-current", "true");
  return row;
}

function showScores({ scores, motion_model: chosen }) {
  const costs = Object.entries(scores).sort((one, other) => one[1] - other[1]);
  byId("models").hidden = costs.length === 0;
  if (!costs.length) return;
  const [least, most] = [costs[0][1], costs[costs.length - 1][1]];
  const share = (cost) => Math.log1p(cost - least) / Math.log1p(Math.max(most - least, 1));
  const rows = costs.map(([name, cost]) => bar(name, share(cost), `+${(cost - least).toFixed(1)}`, name === chosen));
  byId("scores").replaceChildren(...rows);
}

function tableOf(matrix) {
  const cells = (row) => row.map((value) => element("td", { text: value.toExponential(4) }));
  return element("table", { className: "matrix", children: matrix.map((row) => element("tr", { children: cells(row) })) });
}

function showMatrix(photo) {
  const { F, H } = photo.estimate;
  byId("geometry").hidden = !F && !H;
  const given = [["Fundamental matrix F", F], ["Homography H", H]].filter(([, matrix]) => matrix);
  byId("matrix").replaceChildren(...given.flatMap(([title, matrix]) => [element("h2", { text: title }), tableOf(matrix)]));
  const points = F && !H ? [nullVector(F), nullVector(transposed(F))] : []; // beside H they would read as certain
  showPairs(byId("epipoles"), points.map((point, k) => [`epipole ${k + 1}`, placeOf(point)]));
}

/** Where a homogeneous point lies, or its direction if it is farther than 10,000 px. */
function placeOf([x, y, w]) {
  if (Math.abs(w) * 1e4 > Math.hypot(x, y)) return `(${(x / w).toFixed(0)}, ${(y / w).toFixed(0)})`;
  return `at infinity, ${orientationOf(x, y).toFixed(0)}\u00b0`;
}

function showSeconds(seconds) {
  byId("timings").hidden = seconds === null;
  if (seconds === null) return;
  const steps = Object.entries(seconds);
  const total = steps.reduce((sum, [, value]) => sum + value, 0);
  const rows = steps.map(([name, value]) => bar(name, value / total, `${value.toFixed(2)} s`));
  byId("seconds").replaceChildren(...rows, bar("total", 1, `${total.toFixed(2)} s`));
}

const fixed = (value, unit, digits = 2) => `${value.toFixed(digits)}${unit}`;
const both = (...values) => values.map((value) => value.toFixed(Math.hypot(...values) < 100 ? 2 : 1)).join(", ");
const degrees = (radians) => (radians * 180) / Math.PI;

// The values of a smear that are shown: a key, its name, and its text.
const VALUES = [
  ["position", "position x, y", (smear) => `${smear.x}, ${smear.y}`],
  ["displacement", "smear dx, dy", ({ dx, dy }) => `\u00b1(${both(dx, dy)})`],
  ["length", "length", (smear) => fixed(smear.lengthPx, " px")],
  ["direction", "direction", (smear) => fixed(smear.directionDeg, "\u00b0", 1)],
  ["sigma", "uncertainty", (smear) => fixed(smear.sigmaPx, " px")],
  ["sigma-direction", "its direction's", (smear) => (smear.sigmaRad === null ? "-" : fixed(degrees(smear.sigmaRad), "\u00b0", 1))],
  ["error", "distance from lines", (smear) => (smear.order ? fixed(smear.order.errorPx, " px") : "-")],
  ["label", "label", (smear) => (smear.label ? smear.label.name : "-")],
  ["probability", "P(moves)", (smear) => (smear.label ? fixed(smear.label.probability, "") : "-")],
  ["used", "used as", (smear) => (smear.match ? (smear.match.inlier ? "inlier" : "outlier") : "not used")],
];

/** Make the rows of the table of values, once. */
function makeValues() {
  const rows = VALUES.map(([key, name]) => {
    const cells = ["pointer", "chosen"].map((of) => {
      const cell = element("td", { className: of === "pointer" ? "for-mouse" : "", text: "-" });
      cell.dataset.value = key;
      cell.dataset.of = of;
      return cell;
    });
    const head = element("th", { text: name });
    head.scope = "row";
    return element("tr", { children: [head, ...cells] });
  });
  byId("values").tBodies[0].replaceChildren(...rows);
}

/** Fill a column, "pointer" or "chosen", with a smear's values; null empties it. */
function showValues(of, smear) {
  for (const [key, , textOf] of VALUES) {
    byId("values").querySelector(`[data-of="${of}"][data-value="${key}"]`).textContent = smear ? textOf(smear) : "-";
  }
}

/** One sentence about a smear, for those who hear the page. */
function sentenceOf(smear) {
  const values = ["length", "direction", "sigma", "error", "used"].map((key) => {
    const [, name, textOf] = VALUES.find(([other]) => other === key);
    return `${name} ${textOf(smear)}`;
  });
  return `Smear at ${smear.x}, ${smear.y}: ${values.join(", ")}`;
}
