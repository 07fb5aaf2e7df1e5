// The cells of the map, and what can be said of a position: how many of the chosen rotations are
// reached, or, of a single one, how far its witness stays from the joint limits.
const [NOT_COMPUTED, UNREACHABLE, UNDECIDED, FIRST_LEVEL] = [0, 1, 2, 3];
const STATUS = { [NOT_COMPUTED]: "not computed", [UNREACHABLE]: "proven out of reach", [UNDECIDED]: "undecided" };
const ANY = -1;
const TOP_SHARE = 0.99; // of the margins that the colours cover

let atlas; // what the page decoded

const positions = () => atlas.map.shape[0] * atlas.map.shape[1] * atlas.map.shape[2];
const rollCount = () => atlas.map.rolls.length;
const rotationCount = () => atlas.map.rotations.length;
const placeOf = ([i, j, k]) => (i * atlas.map.shape[1] + j) * atlas.map.shape[2] + k;
const indicesOf = (place) => {
  const [, ny, nz] = atlas.map.shape;
  return [Math.floor(place / (ny * nz)), Math.floor(place / nz) % ny, place % nz];
};
const pointOf = (indices) => indices.map((index, axis) => atlas.map.low[axis] + atlas.map.step * index);
const levelOf = (arm, rotation, place) => atlas.map.levels[(arm * rotationCount() + rotation) * positions() + place];
const marginOf = (level) => (level - FIRST_LEVEL) * atlas.map.radPerLevel;

// The arms that a choice speaks of, as indices.
const armsOf = (chosen) => {
  const arm = atlas.map.arms.indexOf(chosen);
  return arm < 0 ? atlas.map.arms.map((_, index) => index) : [arm];
};

// The level of two arms: that of the better one, or, if both are to reach the pose, of the worse.
function combined(one, other, isBoth) {
  if (isBoth) return one === UNREACHABLE || other === UNREACHABLE ? UNREACHABLE : Math.min(one, other);
  const most = Math.max(one, other);
  return most === UNREACHABLE && one !== other ? NOT_COMPUTED : most;
}

function levelAt(chosen, rotation, place) {
  const [one, other] = armsOf(chosen).map((arm) => levelOf(arm, rotation, place));
  return other === undefined ? one : combined(one, other, chosen === "both");
}

// The rotations with a direction and a roll, each of which may be any.
function rotationsOf(direction, roll) {
  const all = Array.from({ length: rotationCount() }, (_, rotation) => rotation);
  return all.filter((r) => (direction === ANY || Math.floor(r / rollCount()) === direction) && (roll === ANY || r % rollCount() === roll));
}

// For each position how many rotations have which status, and the greatest margin's level.
function summarise(chosen, rotations) {
  const n = positions();
  const [reached, unreachable, undecided, best] = [new Uint16Array(n), new Uint16Array(n), new Uint16Array(n), new Uint8Array(n)];
  const [first, ...others] = armsOf(chosen);
  for (const rotation of rotations) {
    for (let place = 0; place < n; place++) {
      const one = levelOf(first, rotation, place);
      const level = others.length ? combined(one, levelOf(others[0], rotation, place), chosen === "both") : one;
      if (level >= FIRST_LEVEL) reached[place]++;
      else if (level === UNREACHABLE) unreachable[place]++;
      else if (level === UNDECIDED) undecided[place]++;
      if (level > best[place]) best[place] = level;
    }
  }
  return { rotations: rotations.length, reached, unreachable, undecided, best };
}

// The margin that the brightest colour stands for, over the whole map.
function topMargin() {
  const counts = new Uint32Array(256);
  for (const level of atlas.map.levels) counts[level]++;
  let left = (1 - TOP_SHARE) * counts.slice(FIRST_LEVEL).reduce((sum, count) => sum + count, 0);
  let level = 255;
  while (level > FIRST_LEVEL && left >= counts[level]) left -= counts[level--];
  return Math.max(Math.ceil(10 * marginOf(level)) / 10, 0.1);
}

// Where the witnesses of each arm, position and direction begin, and its cells among the reachable.
function indexWitnesses() {
  const [n, rolls, directions] = [positions(), rollCount(), atlas.map.directions.length];
  const pairs = atlas.map.arms.length * n * directions;
  const { ofRoll } = atlas.witnesses;
  atlas.firstCell = new Uint32Array(pairs);
  atlas.firstWitness = new Uint32Array(pairs);
  let [cell, witness] = [0, 0];
  for (let pair = 0; pair < pairs; pair++) {
    const direction = pair % directions;
    const place = ((pair - direction) / directions) % n;
    const arm = Math.floor(pair / (directions * n));
    atlas.firstCell[pair] = cell;
    atlas.firstWitness[pair] = witness;
    let most = -1;
    for (let roll = 0; roll < rolls; roll++) {
      if (levelOf(arm, direction * rolls + roll, place) >= FIRST_LEVEL) most = Math.max(most, ofRoll[cell++]);
    }
    witness += most + 1;
  }
}
