// Forward kinematics, and the way from a rounded witness back to one at its pose; the same as in
// sim/view/atlas/witnesses.py. Transforms are 3 x 4, row by row.
const times = (A, B) => {
  const C = new Array(12);
  for (let i = 0; i < 12; i += 4) {
    for (let j = 0; j < 4; j++) C[i + j] = A[i] * B[j] + A[i + 1] * B[4 + j] + A[i + 2] * B[8 + j] + (j === 3 ? A[i + 3] : 0);
  }
  return C;
};
const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];
const minus = (a, b) => a.map((value, i) => value - b[i]);
const length = (vector) => Math.hypot(...vector);
const originOf = (T) => [T[3], T[7], T[11]];
const turned = (T, [x, y, z]) => [0, 4, 8].map((i) => T[i] * x + T[i + 1] * y + T[i + 2] * z);

// About an axis of length 1 (Rodrigues).
function rotation([x, y, z], angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const v = 1 - c;
  return [c + x * x * v, x * y * v - z * s, x * z * v + y * s, 0, x * y * v + z * s, c + y * y * v, y * z * v - x * s, 0, x * z * v - y * s, y * z * v + x * s, c + z * z * v, 0];
}

// Where the joints and the tip are, seen from base.
function forward(arm, q) {
  const joints = [];
  let T = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];
  q.forEach((angle, joint) => {
    T = times(times(T, arm.placements[joint]), rotation(arm.axes[joint], angle));
    joints.push(T);
  });
  return { joints, tip: times(T, arm.tip) };
}

// From the tip to a pose: metres, then the axis of the turn times its angle.
function errorOf(tip, pose) {
  const R = [0, 4, 8].map((i) => [0, 4, 8].map((j) => pose[i] * tip[j] + pose[i + 1] * tip[j + 1] + pose[i + 2] * tip[j + 2]));
  const off = [R[2][1] - R[1][2], R[0][2] - R[2][0], R[1][0] - R[0][1]].map((value) => value / 2);
  const sine = length(off);
  const angle = Math.atan2(sine, (R[0][0] + R[1][1] + R[2][2] - 1) / 2);
  return [...minus(originOf(pose), originOf(tip)), ...off.map((value) => value * (angle / Math.max(sine, 1e-300)))];
}

function polished(arm, start, pose) {
  const { iterations, damping, longest_rad: longest, met } = atlas.polishing;
  const q = [...start];
  for (let iteration = 0; iteration < iterations; iteration++) {
    const { joints, tip } = forward(arm, q);
    const error = errorOf(tip, pose);
    if (Math.max(...error.map(Math.abs)) <= met) break;
    const columns = joints.map((T, joint) => {
      const axis = turned(T, arm.axes[joint]);
      return [...cross(axis, minus(originOf(tip), originOf(T))), ...axis];
    }).slice(1);
    const normal = error.map((_, i) => error.map((__, j) => columns.reduce((sum, J) => sum + J[i] * J[j], i === j ? damping : 0)));
    const y = solved(normal, error);
    const step = columns.map((J) => J.reduce((sum, value, i) => sum + value * y[i], 0));
    const shorter = Math.min(1, longest / (Math.max(...step.map(Math.abs)) + 1e-300));
    step.forEach((value, joint) => { q[joint + 1] += shorter * value; });
  }
  return q;
}

// Gauss with the largest pivots.
function solved(matrix, right) {
  const rows = matrix.map((row, i) => [...row, right[i]]);
  const n = rows.length;
  for (let i = 0; i < n; i++) {
    const pivot = rows.slice(i).reduce((best, row, at) => (Math.abs(row[i]) > Math.abs(rows[best][i]) ? i + at : best), i);
    [rows[i], rows[pivot]] = [rows[pivot], rows[i]];
    for (let k = i + 1; k < n; k++) {
      const share = rows[k][i] / rows[i][i];
      for (let j = i; j <= n; j++) rows[k][j] -= share * rows[i][j];
    }
  }
  const x = new Array(n).fill(0);
  for (let i = n - 1; i >= 0; i--) x[i] = rows[i].slice(i + 1, n).reduce((sum, value, j) => sum - value * x[i + 1 + j], rows[i][n]) / rows[i][i];
  return x;
}

const wrapped = (angle) => angle - 2 * Math.PI * Math.floor((angle + Math.PI) / (2 * Math.PI));
const marginsOf = (arm, q) => q.map((angle, joint) => Math.min(angle - arm.low[joint], arm.high[joint] - angle));

const poseOf = (rotation, point) => {
  const R = atlas.map.rotations[rotation];
  return [0, 1, 2].flatMap((row) => [...R.slice(3 * row, 3 * row + 3), point[row]]);
};

// The stored configuration that is nearest to a reachable cell's witness, w2 turned to its roll.
function storedWitness(side, rotation, place) {
  const a = atlas.map.arms.indexOf(side);
  const [rolls, w] = [rollCount(), atlas.witnesses];
  const [direction, roll] = [Math.floor(rotation / rolls), rotation % rolls];
  const pair = (a * positions() + place) * atlas.map.directions.length + direction;
  let cell = atlas.firstCell[pair];
  for (let other = 0; other < roll; other++) if (levelOf(a, direction * rolls + other, place) >= FIRST_LEVEL) cell++;
  const index = atlas.firstWitness[pair] + w.ofRoll[cell];
  const q = keptWitness(index) || unrounded(atlas.arms[side], index);
  q[6] = wrapped(q[6] + atlas.map.rolls[roll]);
  return q;
}

function keptWitness(index) {
  const { kept, keptSteps, radPerStep } = atlas.witnesses;
  const at = countUntil(kept, index) - 1;
  return kept[at] === index ? Array.from(keptSteps.slice(7 * at, 7 * at + 7), (steps) => steps * radPerStep) : null;
}

function unrounded(arm, index) {
  const { firstHigh, firstLow, others, bits } = atlas.witnesses;
  const n = firstLow.length;
  const steps = [256 * firstHigh[index] + firstLow[index], ...Array.from({ length: 6 }, (_, joint) => others[joint * n + index])];
  return steps.map((count, joint) => {
    const turn = joint === 6 ? Math.PI : 0; // w2 at roll zero may lie anywhere
    const [low, high] = [Math.min(arm.low[joint], -turn), Math.max(arm.high[joint], turn)];
    return low + (count * (high - low)) / (2 ** bits[joint] - 1);
  });
}

// A configuration for a reachable cell with its errors by forward kinematics; only one that is
// within the tolerances and the limits may be shown.
function witnessOf(side, rotation, place) {
  const arm = atlas.arms[side];
  const pose = poseOf(rotation, pointOf(indicesOf(place)));
  const q = polished(arm, storedWitness(side, rotation, place), pose);
  const error = errorOf(forward(arm, q).tip, pose);
  const [offset, angle] = [length(error.slice(0, 3)), length(error.slice(3))];
  const margins = marginsOf(arm, q);
  const { tolerance } = atlas.polishing;
  return { side, q, offset, angle, margins, isMet: offset <= tolerance && angle <= tolerance && Math.min(...margins) >= 0 };
}
