// Distorting cameras: F holds for undistorted pixels, so that its lines are curves in the photograph.

/** Where pixels would lie without distortion, known at every step-th pixel, bilinear between. */
class Lens {
  constructor(step, shift) {
    this.step = step;
    this.shift = shift;
    [, this.rows, this.columns] = shift.shape;
  }

  /** Undistorted pixel of node (row, column). */
  node(row, column) {
    const index = row * this.columns + column;
    const plane = this.rows * this.columns;
    return [column * this.step + this.shift.at(index), row * this.step + this.shift.at(plane + index)];
  }

  /** Undistorted pixel of a pixel; beyond the photograph the nearest cell continues. */
  straight([x, y]) {
    const column = Math.min(Math.max(Math.floor(x / this.step), 0), this.columns - 2);
    const row = Math.min(Math.max(Math.floor(y / this.step), 0), this.rows - 2);
    const u = x / this.step - column;
    const v = y / this.step - row;
    const corners = [[0, 0], [0, 1], [1, 0], [1, 1]].map(([down, right]) => this.node(row + down, column + right));
    const weights = [(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v];
    return [0, 1].map((axis) => corners.reduce((sum, corner, k) => sum + weights[k] * corner[axis], 0));
  }

  /** Pieces of the curve on which a line of undistorted pixels lies (marching triangles). */
  curve([a, b, c]) {
    const side = (row, column) => {
      const [x, y] = this.node(row, column);
      return a * x + b * y + c;
    };
    const pieces = [];
    for (let row = 0; row + 1 < this.rows; row++) {
      for (let column = 0; column + 1 < this.columns; column++) {
        const corners = [[row, column], [row, column + 1], [row + 1, column + 1], [row + 1, column]];
        const values = corners.map(([r, k]) => side(r, k));
        for (const triangle of [[0, 1, 2], [0, 2, 3]]) {
          const piece = this.crossing(triangle.map((k) => corners[k]), triangle.map((k) => values[k]));
          if (piece.length === 2) pieces.push(piece);
        }
      }
    }
    return pieces;
  }

  /** Where the border of a triangle of nodes changes side, at most two points. */
  crossing(nodes, values) {
    const points = [];
    for (const [i, j] of [[0, 1], [1, 2], [2, 0]]) {
      if (values[i] < 0 === values[j] < 0) continue;
      const share = values[i] / (values[i] - values[j]);
      const [row, column] = [0, 1].map((axis) => nodes[i][axis] + share * (nodes[j][axis] - nodes[i][axis]));
      points.push([column * this.step, row * this.step]);
    }
    return points;
  }
}
