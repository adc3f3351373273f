// An orthographic look at the job: a target in mm, pixels per mm, and for passes a direction.
const MARGIN = 0.9;
const DEG = Math.PI / 180;

export class Camera {
  constructor(low, high) {
    [this.low, this.high] = [low, high];
    this.size = [1, 1];
    this.look(0, 90);
    this.fit();
  }

  look(azimuth, elevation) {
    this.azimuth = azimuth;
    this.elevation = Math.min(Math.max(elevation, -90), 90);
    const [ca, sa] = [Math.cos(azimuth * DEG), Math.sin(azimuth * DEG)];
    const [ce, se] = [Math.cos(this.elevation * DEG), Math.sin(this.elevation * DEG)];
    this.right = [ca, sa, 0];
    this.up = [-sa * se, ca * se, ce];
    this.towards = [sa * ce, -ca * ce, se];
  }

  fit() {
    this.target = this.low.map((low, k) => (low + this.high[k]) / 2);
    const reach = (axis) => axis.reduce(
      (sum, part, k) => sum + Math.abs(part) * (this.high[k] - this.low[k]), 0);
    const [w, h] = this.size;
    this.scale = MARGIN * Math.min(w / Math.max(reach(this.right), 1e-3),
      h / Math.max(reach(this.up), 1e-3));
  }

  u(x, y, z) {
    const [[a, b], [tx, ty]] = [this.right, this.target];
    return this.size[0] / 2 + this.scale * (a * (x - tx) + b * (y - ty));
  }

  v(x, y, z) {
    const [[a, b, c], [tx, ty, tz]] = [this.up, this.target];
    return this.size[1] / 2 - this.scale * (a * (x - tx) + b * (y - ty) + c * (z - tz));
  }

  depth(x, y, z) {
    const [a, b, c] = this.towards;
    return a * x + b * y + c * z;
  }

  pan(du, dv) {
    this.target = this.target.map(
      (t, k) => t - (du / this.scale) * this.right[k] + (dv / this.scale) * this.up[k]);
  }

  zoom(factor, u, v) {
    const [du, dv] = [u - this.size[0] / 2, v - this.size[1] / 2];
    const scale = Math.min(Math.max(this.scale * factor, 0.05), 2e5);
    const moved = 1 - scale / this.scale;
    this.scale = scale;
    this.pan(du * moved, dv * moved);
  }
}
