// A photograph made by arithmetic, in linear light: what would fall on a sensor, before any response.

/**
 * @typedef {[number, number, number]} Light of red, green and blue; white paper in the light is 1
 * @typedef {{ x: number, y: number, radius: number, colour: Light }} Ball
 */

const WIDTH = 264;
const HEIGHT = 198;
const LEVELS = 1024;
const HORIZON = 0.5;
const TABLE = 0.64; // where it begins, as a share of the height
const WEDGE = 0.88; // where the grey steps begin: each half as bright as the one before
const STEPS = 9;
const SUN = { x: 0.74, y: 0.2 };
const TOWARDS = [0.55, -0.62, 0.56]; // the light on the balls, of length 1

/** @type {Ball[]} */
const BALLS = [
  { x: 0.2, y: 0.66, radius: 0.12, colour: [0.55, 0.045, 0.035] },
  { x: 0.45, y: 0.7, radius: 0.095, colour: [0.75, 0.44, 0.03] },
  { x: 0.67, y: 0.67, radius: 0.115, colour: [0.03, 0.14, 0.42] },
  { x: 0.9, y: 0.72, radius: 0.08, colour: [0.85, 0.85, 0.82] },
];

/** @type {(a: Light, b: Light, share: number) => Light} */
const mix = (a, b, share) => /** @type {Light} */ (a.map((value, i) => value + share * (b[i] - value)));
/** @type {(light: Light, factor: number) => Light} */
const times = (light, factor) => /** @type {Light} */ (light.map((value) => value * factor));

/** @type {(x: number, y: number) => Light} */
function sky(x, y) {
  const glow = Math.exp(-40 * ((x - SUN.x) ** 2 + (y - SUN.y) ** 2));
  const disc = (x - SUN.x) ** 2 + ((y - SUN.y) * HEIGHT) ** 2 / WIDTH ** 2 < 0.0016 ? 1 : 0;
  const cloud = 0.16 * Math.max(0, Math.sin(9 * x + 3 * Math.sin(21 * y)) * Math.sin(24 * y + 2 * x));
  const clear = mix([0.1, 0.21, 0.5], [0.5, 0.47, 0.42], Math.min(1, y / HORIZON) ** 1.5);
  return mix(mix(clear, [0.8, 0.78, 0.74], cloud), [1, 0.93, 0.75], Math.max(disc, 0.75 * glow));
}

/** @type {(x: number, y: number) => Light} */
function land(x, y) {
  const far = HORIZON - 0.05 - 0.045 * Math.sin(5 * x + 1) - 0.02 * Math.sin(17 * x);
  const near = HORIZON + 0.05 - 0.03 * Math.sin(7 * x + 4);
  if (y < far) return sky(x, y);
  if (y < near) return mix([0.1, 0.13, 0.16], [0.035, 0.07, 0.04], (y - far) / (near - far));
  const trees = 0.5 + 0.5 * Math.sin(150 * x + 11 * Math.sin(40 * y)) * Math.sin(130 * y);
  return mix([0.006, 0.014, 0.006], [0.03, 0.05, 0.014], trees);
}

/** @type {(x: number, y: number) => Light} */
function table(x, y) {
  const grain = 0.5 + 0.5 * Math.sin(90 * (y + 0.03 * Math.sin(6 * x)) + 2 * Math.sin(23 * x));
  const wood = mix([0.11, 0.055, 0.025], [0.2, 0.11, 0.05], grain);
  const shade = BALLS.reduce((least, ball) => {
    const across = (x - ball.x + 0.75 * ball.radius) / (1.5 * ball.radius);
    const down = ((y - ball.y - 1.05 * ball.radius) * HEIGHT) / WIDTH / (0.36 * ball.radius);
    return Math.min(least, Math.max(0.06, Math.min(1, across ** 2 + down ** 2)));
  }, 1);
  return times(wood, shade * (0.5 + 0.9 * x));
}

/** @type {(ball: Ball, x: number, y: number) => Light | null} */
function onBall({ x: atX, y: atY, radius, colour }, x, y) {
  const [across, down] = [(x - atX) / radius, ((y - atY) * HEIGHT) / WIDTH / radius];
  const square = across ** 2 + down ** 2;
  if (square > 1) return null;
  const lit = across * TOWARDS[0] + down * TOWARDS[1] + Math.sqrt(1 - square) * TOWARDS[2];
  const gloss = Math.max(0, 2 * lit * Math.sqrt(1 - square) - TOWARDS[2]) ** 30;
  return mix(times(colour, 0.035 + 0.95 * Math.max(0, lit)), [1, 1, 0.95], 0.8 * gloss);
}

/** @type {(x: number, y: number) => Light} */
export function lightAt(x, y) {
  // Two rows, one the other way round, so that both halves of the picture have all steps nearby.
  if (y > WEDGE) return times([1, 1, 1], 2 ** -Math.floor((y < (WEDGE + 1) / 2 ? x : 1 - x) * STEPS));
  for (const ball of BALLS) {
    const light = onBall(ball, x, y);
    if (light) return light;
  }
  return y < TABLE ? land(x, y) : table(x, y);
}

// Levels lie denser in the dark, where responses are steep. A fixed grain hides what steps are left.
export function renderScene() {
  const levels = Float64Array.from({ length: LEVELS }, (_, i) => (i / (LEVELS - 1)) ** 2);
  const codes = new Uint16Array(3 * WIDTH * HEIGHT);
  for (let pixel = 0; pixel < WIDTH * HEIGHT; pixel++) {
    const grain = ((pixel * 2654435761) % 4096) / 4096 - 0.5;
    const light = lightAt(((pixel % WIDTH) + 0.5) / WIDTH, (Math.floor(pixel / WIDTH) + 0.5) / HEIGHT);
    light.forEach((value, channel) => {
      codes[3 * pixel + channel] = Math.min(LEVELS - 1, Math.round(Math.sqrt(value) * (LEVELS - 1) + 6 * grain + 3));
    });
  }
  return { width: WIDTH, height: HEIGHT, codes, levels };
}
