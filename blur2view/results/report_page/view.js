// What the stage shows of the photograph: pixels to places on the screen and back, zoom and pan.

const CLOSEST = 16; // screen pixels per pixel of the photograph

class View {
  constructor(photo, width, height) {
    this.photo = photo;
    this.resize(width, height);
  }

  /** Show the whole photograph on a stage of this size. */
  resize(width, height) {
    this.width = width;
    this.height = height;
    this.least = Math.min(width / this.photo.width, height / this.photo.height);
    this.fit();
  }

  fit() {
    this.scale = this.least;
    this.left = 0;
    this.top = 0;
  }

  get zoomed() {
    return this.scale > 1.001 * this.least;
  }

  /** Pixel (0, 0) is the centre of the first pixel, half a pixel from the photograph's corner. */
  toScreen([x, y]) {
    return [this.left + (x + 0.5) * this.scale, this.top + (y + 0.5) * this.scale];
  }

  toPhoto([x, y]) {
    return [(x - this.left) / this.scale - 0.5, (y - this.top) / this.scale - 0.5];
  }

  shows(point) {
    const [x, y] = this.toScreen(point);
    return x >= 0 && y >= 0 && x <= this.width && y <= this.height;
  }

  /** Zoom by a factor; the place [x, y] on the screen keeps its pixel. */
  zoom(factor, [x, y] = [this.width / 2, this.height / 2]) {
    const scale = Math.min(Math.max(this.scale * factor, this.least), Math.max(CLOSEST, this.least));
    this.left = x - ((x - this.left) * scale) / this.scale;
    this.top = y - ((y - this.top) * scale) / this.scale;
    this.scale = scale;
    this.clamp();
  }

  pan(dx, dy) {
    this.left += dx;
    this.top += dy;
    this.clamp();
  }

  /** Pan until a pixel is seen, a margin away from the border. */
  reveal(point, margin = 24) {
    const [x, y] = this.toScreen(point);
    const missing = (value, size) => Math.min(Math.max(margin - value, 0), size) - Math.max(value - (size - margin), 0);
    if (this.zoomed) this.pan(missing(x, this.width), missing(y, this.height));
  }

  /** Leave no empty border. */
  clamp() {
    this.left = Math.min(0, Math.max(this.left, this.width - this.photo.width * this.scale));
    this.top = Math.min(0, Math.max(this.top, this.height - this.photo.height * this.scale));
  }
}
