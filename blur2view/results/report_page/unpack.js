// The inverse of report_pack.py: base64 -> deflate -> planes of bytes -> differences -> integers.

const ARRAYS = { uint8: Uint8Array, int16: Int16Array, uint16: Uint16Array, int32: Int32Array };

function bytesOf(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** An array of integers that stand for value / step. */
class Packed {
  constructor(values, shape, step) {
    this.values = values;
    this.shape = shape;
    this.step = step;
  }

  at(index) {
    return this.values[index] * this.step;
  }
}

async function unpacked(packed) {
  if (packed === null) return null;
  const planes = await inflated(bytesOf(packed.data));
  const Kind = ARRAYS[packed.type];
  const count = planes.length / Kind.BYTES_PER_ELEMENT;
  const values = new Kind(count); // assignments and sums wrap around, as the differences did
  const width = packed.shape[packed.shape.length - 1];
  for (let i = 0; i < count; i++) {
    let delta = 0;
    for (let b = 0; b < Kind.BYTES_PER_ELEMENT; b++) delta |= planes[b * count + i] << (8 * b);
    values[i] = i % width ? values[i - 1] + delta : delta;
  }
  return new Packed(values, packed.shape, packed.step);
}

async function imageOf(uri) {
  const image = new Image();
  image.src = uri;
  await image.decode();
  return image;
}

/** The record of photograph number `index`, with its arrays unpacked. */
async function photographOf(index) {
  const record = JSON.parse(document.getElementById(`photo-data-${index}`).textContent);
  const { grid, matches, mask, lens } = record;
  const [picture, displacement, sigmaPx, sigmaRad, ends, flags, labels, probability, shift, circles] = await Promise.all([
    imageOf(record.picture),
    ...[grid.displacement, grid.sigma_px, grid.sigma_rad, matches.ends, matches.flags].map(unpacked),
    ...[mask && mask.labels, mask && mask.probability, lens && lens.shift, record.circles].map(unpacked),
  ]);
  return {
    name: record.name,
    width: record.width,
    height: record.height,
    kind: record.kind,
    meaning: record.meaning,
    medianPx: record.median_px,
    seconds: record.seconds,
    text: record.document,
    estimate: JSON.parse(record.document),
    picture,
    grid: {
      x0: grid.x0,
      y0: grid.y0,
      step: grid.step_px,
      columns: displacement.shape[2],
      rows: displacement.shape[1],
      displacement,
      sigmaPx,
      sigmaRad,
    },
    circles: Array.from({ length: circles.shape[1] }, (_, k) => {
      const [x, y, radius] = [0, 1, 2].map((row) => circles.at(row * circles.shape[1] + k));
      return { x, y, radius };
    }),
    matches: { count: flags.values.length, spacing: matches.spacing_px, ends, flags },
    lens: lens && new Lens(lens.step_px, shift),
    mask: mask && { labels, every: mask.every_px, probability, headline: mask.headline, reason: mask.reason },
  };
}
