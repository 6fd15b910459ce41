// How the stage is used: mouse, pen, fingers and keys become calls of the viewer.

Viewer.prototype.listen = function () {
  const { stage } = this;
  stage.addEventListener("pointerdown", (event) => this.down(event));
  stage.addEventListener("pointermove", (event) => this.move(event));
  stage.addEventListener("pointerup", (event) => this.up(event));
  stage.addEventListener("pointercancel", (event) => this.pointers.delete(event.pointerId));
  stage.addEventListener("pointerleave", () => showValues("pointer", null));
  stage.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
  stage.addEventListener("keydown", (event) => this.key(event));
  this.boxes.forEach((box) => box.addEventListener("change", () => this.drawSoon()));
  for (const button of document.querySelectorAll("[data-zoom]")) {
    button.addEventListener("click", () => this.zoom(button.dataset.zoom));
  }
  new ResizeObserver(() => this.measure()).observe(stage);
};

Viewer.prototype.placeOf = function (event) {
  const { left, top } = this.stage.getBoundingClientRect();
  return [event.clientX - left - this.stage.clientLeft, event.clientY - top - this.stage.clientTop];
};

Viewer.prototype.down = function (event) {
  const place = this.placeOf(event);
  this.pointers.set(event.pointerId, { place, from: place, moved: this.pointers.size > 0 });
  this.stage.setPointerCapture(event.pointerId);
};

Viewer.prototype.move = function (event) {
  const place = this.placeOf(event);
  const pointer = this.pointers.get(event.pointerId);
  if (pointer) this.drag(pointer, place);
  else if (event.pointerType !== "touch") showValues("pointer", this.smearUnder(place));
};

/** Move one pointer that is down: alone it pans, with another it zooms too. */
Viewer.prototype.drag = function (pointer, place) {
  const others = [...this.pointers.values()].filter((other) => other !== pointer);
  if (Math.hypot(place[0] - pointer.from[0], place[1] - pointer.from[1]) > STILL_PX) pointer.moved = true;
  if (!pointer.moved) return;
  const share = others.length ? 0.5 : 1; // two fingers that move together pan by half of each one's way
  const before = pointer.place;
  pointer.place = place;
  this.view.pan(share * (place[0] - before[0]), share * (place[1] - before[1]));
  if (others.length) {
    const [x, y] = others[0].place;
    const spread = ([px, py]) => Math.max(Math.hypot(px - x, py - y), 1);
    this.view.zoom(spread(place) / spread(before), [(place[0] + x) / 2, (place[1] + y) / 2]);
  }
  this.drawSoon();
};

Viewer.prototype.up = function (event) {
  const pointer = this.pointers.get(event.pointerId);
  this.pointers.delete(event.pointerId);
  if (pointer && !pointer.moved) this.choose(this.smearUnder(this.placeOf(event)));
};

/** Zoom with Ctrl and the wheel, which is also what a pinch on a touchpad sends; the wheel alone scrolls. */
Viewer.prototype.wheel = function (event) {
  if (!event.ctrlKey && !event.metaKey) return;
  event.preventDefault();
  this.view.zoom(Math.exp(-event.deltaY / 200), this.placeOf(event));
  this.drawSoon();
};

Viewer.prototype.key = function (event) {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const zooms = { "+": "in", "=": "in", "-": "out", 0: "fit" };
  if (event.key in ARROWS) this.step(ARROWS[event.key], event.shiftKey ? 1 : stride(this.view, this.photo));
  else if (event.key in zooms) this.zoom(zooms[event.key]);
  else if (event.key === "Escape") this.choose(null);
  else if ((event.key === "Enter" || event.key === " ") && !this.chosen) this.step([0, 0], 0);
  else return;
  event.preventDefault();
};
