// Colours: orientation as in the overlays of `blur2view estimate`, heat on viridis and magma.

const VIRIDIS = ["440154", "482878", "3e4989", "31688e", "26828e", "1f9e89", "35b779", "6ece58", "b5de2b", "fde725"];
const MAGMA = ["000004", "180f3d", "440f76", "721f81", "9e2f7f", "cd4071", "f1605d", "fd9668", "feca8d", "fcfdbf"];
const HUES = 36;

function triple(hex) {
  return [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16));
}

/** 256 colours [r, g, b] along a list of stops. */
function ramp(stops) {
  const colours = stops.map(triple);
  return Array.from({ length: 256 }, (_, level) => {
    const place = (level / 255) * (colours.length - 1);
    const below = Math.min(Math.floor(place), colours.length - 2);
    return [0, 1, 2].map((k) => colours[below][k] + (place - below) * (colours[below + 1][k] - colours[below][k]));
  });
}

/** Direction of a smear in degrees, 0 to 180, clockwise from the x axis. */
function orientationOf(dx, dy) {
  const degrees = (Math.atan2(dy, dx) * 180) / Math.PI;
  return (degrees + 360) % 180;
}

/** One of HUES buckets of an orientation. */
function bucketOf(dx, dy) {
  return Math.round((orientationOf(dx, dy) / 180) * HUES) % HUES;
}

function hueColour(bucket, alpha = 1) {
  return `hsl(${(bucket * 360) / HUES} 100% 63% / ${alpha})`;
}

/** A colour as the four bytes of a pixel in memory. */
function pixelOf([red, green, blue], alpha) {
  return new Uint32Array(new Uint8Array([red, green, blue, alpha].map(Math.round)).buffer)[0];
}

/** A canvas of one pixel per value; `paint(index)` gives its `pixelOf`. */
function painted(width, height, paint) {
  const canvas = document.createElement("canvas");
  canvas.width = width;
  canvas.height = height;
  const context = canvas.getContext("2d");
  const image = context.createImageData(width, height);
  const pixels = new Uint32Array(image.data.buffer);
  for (let i = 0; i < pixels.length; i++) pixels[i] = paint(i);
  context.putImageData(image, 0, 0);
  return canvas;
}
