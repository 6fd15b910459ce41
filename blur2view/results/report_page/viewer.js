// The stage: layers, the chosen smear with its ends and epipolar lines, pointer, touch and keyboard.

const STILL_PX = 5; // a pointer that moves less between down and up has clicked
const END_COLOURS = ["#22d3ee", "#fbbf24"]; // of the first and the second end, and of the lines in their views
const LINE_WIDTHS = [4, 1.5]; // where both lines coincide both are seen
const ZOOM_STEP = 1.5;
const ARROWS = { ArrowLeft: [0, -1], ArrowRight: [0, 1], ArrowUp: [-1, 0], ArrowDown: [1, 0] };
const SVG = "http://www.w3.org/2000/svg";

class Viewer {
  constructor() {
    this.stage = byId("stage");
    this.canvas = byId("canvas");
    this.marks = byId("marks");
    this.boxes = [...document.querySelectorAll("[data-layer]")];
    this.pointers = new Map();
    makeValues();
    this.listen();
  }

  get layers() {
    return new Set(this.boxes.filter((box) => box.checked && !box.disabled).map((box) => box.dataset.layer));
  }

  /** Show a photograph from `photographOf`. */
  show(photo) {
    indexMatches(photo);
    this.photo = photo;
    this.stage.style.aspectRatio = `${photo.width} / ${photo.height}`;
    byId("stage-frame").style.setProperty("--shape", photo.width / photo.height);
    this.offer(photo);
    showEstimate(photo);
    this.measure();
    this.choose(null);
    showValues("pointer", null);
  }

  /** Offer the layers that this photograph has. */
  offer(photo) {
    const { mask } = photo;
    const { F, H } = photo.estimate;
    const lines = Boolean(F) && !H; // beside H they would tell what nothing shows
    const has = { inliers: photo.used.length > 0, circles: photo.circles.length > 0, lines, mask, probability: mask };
    for (const box of this.boxes) {
      box.disabled = box.dataset.layer in has && !has[box.dataset.layer];
      box.parentElement.classList.toggle("layer-absent", box.disabled);
    }
    const [low, high] = sigmaRange(photo);
    byId("sigma-low").textContent = `${low.toPrecision(2)} px`;
    byId("sigma-high").textContent = `${high.toPrecision(2)} px`;
    byId("mask-reason").textContent = mask ? `${mask.headline}; ${mask.reason}` : "";
  }

  /** Take the stage's size, and show the whole photograph in it. */
  measure() {
    const { width, height } = this.stage.getBoundingClientRect();
    const { view } = this;
    const same = view && view.photo === this.photo && view.width === width && view.height === height;
    if (!this.photo || !width || same) return;
    this.ratio = window.devicePixelRatio || 1;
    this.canvas.width = Math.round(width * this.ratio);
    this.canvas.height = Math.round(height * this.ratio);
    this.view = new View(this.photo, width, height);
    this.draw();
  }

  draw() {
    const { layers } = this;
    drawLayers(this.canvas.getContext("2d"), this.view, this.photo, layers, this.ratio);
    this.stage.classList.toggle("stage-zoomed", this.view.zoomed);
    for (const key of document.querySelectorAll("[data-key]")) {
      key.hidden = !key.dataset.key.split(" ").some((layer) => layers.has(layer));
    }
    this.mark();
  }

  drawSoon() {
    if (this.pending) return;
    this.pending = requestAnimationFrame(() => {
      this.pending = 0;
      this.draw();
    });
  }

  /** Draw the chosen smear, its ends and both epipolar lines, in pixels of the screen. */
  mark() {
    this.marks.replaceChildren();
    const smear = this.chosen;
    if (!smear) return;
    const { F, H } = this.photo.estimate;
    const ends = smear.order ? inOrder(smear.ends, smear.order) : smear.ends;
    if (F && !H) {
      const [first, second] = straightened(this.photo, ends);
      const lines = [lineInView1(F, second), lineInView2(F, first)].map((line) => drawnLine(this.photo, line));
      lines.forEach((pieces, k) => this.markPiece(`line-${k + 1}-halo`, pieces, "rgb(0 0 0 / 0.5)", LINE_WIDTHS[k] + 2));
      lines.forEach((pieces, k) => this.markPiece(`line-${k + 1}`, pieces, END_COLOURS[k], LINE_WIDTHS[k]));
    }
    this.markPiece("smear-halo", [ends], "black", 6);
    this.markPiece("smear", [ends], "white", 2.5);
    ends.forEach((end, k) => this.markEnd(end, k, Boolean(smear.order)));
  }

  markPiece(name, pieces, colour, width) {
    const place = (point) => this.view.toScreen(point).map((value) => value.toFixed(3)).join(" ");
    const d = pieces.map(([from, to]) => `M${place(from)}L${place(to)}`).join("");
    this.markShape("path", { "data-mark": name, d, fill: "none", stroke: colour, "stroke-width": width, "stroke-linecap": "round" });
  }

  markEnd(end, k, known) {
    const [cx, cy] = this.view.toScreen(end);
    const fill = known ? END_COLOURS[k] : "white";
    this.markShape("circle", { "data-mark": `end-${k + 1}`, cx, cy, r: 5, fill, stroke: "black", "stroke-width": 1.5 });
    if (known) this.markNumber([cx, cy], k);
  }

  /** Write the end's number beside it, away from the other end. */
  markNumber([x, y], k) {
    const [one, other] = inOrder(this.chosen.ends, this.chosen.order).map((point) => this.view.toScreen(point));
    const away = difference(k ? [one, other] : [other, one]);
    const length = Math.hypot(...away) || 1;
    const looks = { fill: END_COLOURS[k], stroke: "black", "stroke-width": 3, "paint-order": "stroke" };
    const type = { "text-anchor": "middle", "dominant-baseline": "central", "font-size": 14, "font-weight": 700, "font-family": "sans-serif" };
    const place = { x: x + (16 * away[0]) / length, y: y + (16 * away[1]) / length };
    this.markShape("text", { ...place, ...looks, ...type }).textContent = String(k + 1);
  }

  /** Add a shape; its looks are attributes, so that a saved picture has them too. */
  markShape(tag, attributes) {
    const shape = document.createElementNS(SVG, tag);
    for (const [key, value] of Object.entries(attributes)) shape.setAttribute(key, value);
    this.marks.append(shape);
    return shape;
  }

  choose(smear) {
    this.chosen = smear;
    showValues("chosen", smear);
    byId("values").classList.toggle("values-empty", !smear);
    if (smear && this.view) this.view.reveal([smear.x, smear.y]);
    if (this.view) this.drawSoon();
  }

  /** The smear at a place of the stage: where used ones are drawn that of the cell, else the nearest node's. */
  smearUnder(place) {
    const [x, y] = this.view.toPhoto(place);
    const match = this.layers.has("inliers") && matchAt(this.photo, { x, y });
    return match ? smearOfMatch(this.photo, match) : smearAt(this.photo, ...nearestNode(this.photo, [x, y]));
  }

  /** Choose the smear some nodes away; the photograph's middle if none is chosen. */
  step([down, right], nodes) {
    const { grid } = this.photo;
    const within = (value, count) => Math.min(Math.max(value, 0), count - 1);
    const from = this.chosen || { row: (grid.rows >> 1) - nodes * down, column: (grid.columns >> 1) - nodes * right };
    const row = within(from.row + nodes * down, grid.rows);
    const column = within(from.column + nodes * right, grid.columns);
    this.choose(smearAt(this.photo, row, column));
    byId("spoken").textContent = sentenceOf(this.chosen);
  }

  zoom(how, about) {
    if (how === "fit") this.view.fit();
    else this.view.zoom(how === "in" ? ZOOM_STEP : 1 / ZOOM_STEP, about || this.focusPlace());
    this.drawSoon();
  }

  /** Where to zoom without a pointer: at the chosen smear, else at the middle. */
  focusPlace() {
    return this.chosen ? this.view.toScreen([this.chosen.x, this.chosen.y]) : undefined;
  }
}
