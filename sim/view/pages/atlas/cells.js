// The map in the scene: a cube for each position that is reached, tiles where the plane cuts it, the
// plane itself with its scale, and what is chosen.
const TILE = { width: 0.94, height: 0.1 };
const DOT = 0.1;
const CUBE = { least: 0.42, through: 0.1, most: 0.95, one: 0.5 };
const UNDECIDED_SIZE = 0.36;
const BAR_M = 0.009;
const ARROW_M = 0.16;
const ARROW_RADIUS_M = 0.006;
const AXES_COLOURS = ["#c8202a", "#1f8a2f", "#1c5fd0"]; // x, y, z
const LABEL_BESIDE_M = 0.12;
const LABEL_SIZE = 0.02; // of the view's height, about; the same far and near
const LABEL_STEPS_M = [0.5, 1, 2];

const drawn = { cubes: null, root: null, plane: null, cage: null, frame: null, boxes: [], summary: null };

function createCells() {
  const { Group, InstancedMesh, BoxGeometry, MeshPhongMaterial, Color } = MeshCat.THREE;
  drawn.root = new Group();
  viewer.scene.add(drawn.root);
  const surface = new MeshPhongMaterial({ specular: 0x222222, shininess: 20 });
  drawn.cubes = new InstancedMesh(new BoxGeometry(1, 1, 1), surface, positions());
  drawn.cubes.frustumCulled = false;
  drawn.cubes.receiveShadow = true;
  drawn.cubes.setColorAt(0, new Color(0xffffff));
  drawn.plane = createPlane();
  drawn.cage = createCage();
  drawn.frame = createFrame();
  drawn.root.add(drawn.cubes, drawn.plane, drawn.cage, drawn.frame);
}

const flat = (colour, opacity = 1) => new MeshCat.THREE.MeshBasicMaterial({ color: colour, transparent: opacity < 1, opacity, depthWrite: opacity === 1, side: MeshCat.THREE.DoubleSide });

function bar(from, to, width, material) {
  const { Mesh, BoxGeometry } = MeshCat.THREE;
  const size = from.map((value, axis) => Math.abs(to[axis] - value) + width);
  const mesh = new Mesh(new BoxGeometry(...size), material);
  mesh.position.set(...from.map((value, axis) => (value + to[axis]) / 2));
  return mesh;
}

// The plane at the chosen height: its edge, and coordinates along two sides.
function createPlane() {
  const { Group, Mesh, PlaneGeometry } = MeshCat.THREE;
  const [low, high] = [pointOf([0, 0, 0]), pointOf(atlas.map.shape.map((n) => n - 1))].map((p, end) => p.map((x) => x + (end - 0.5) * atlas.map.step));
  const plane = new Group();
  const sheet = new Mesh(new PlaneGeometry(high[0] - low[0], high[1] - low[1]), flat("#8fa3b8", 0.16));
  sheet.position.set((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, 0);
  sheet.renderOrder = 1;
  const edge = flat("#5b6f84");
  const corners = [[low[0], low[1], 0], [high[0], low[1], 0], [high[0], high[1], 0], [low[0], high[1], 0]];
  const edges = corners.map((corner, i) => bar(corner, corners[(i + 1) % 4], BAR_M, edge));
  const scales = [...labels(0, low, high, low[1] - LABEL_BESIDE_M, "x"), ...labels(1, low, high, high[0] + LABEL_BESIDE_M, "y")];
  plane.add(sheet, ...edges, ...scales);
  return plane;
}

function labels(axis, low, high, beside, name) {
  const span = high[axis] - low[axis];
  const step = LABEL_STEPS_M.find((each) => span / each <= 6) || Math.ceil(span / 6);
  const first = Math.ceil(low[axis] / step);
  const count = Math.floor(high[axis] / step) - first + 1;
  return Array.from({ length: Math.max(count, 0) }, (_, i) => {
    const value = (first + i) * step;
    const sprite = label(`${name} ${signedMetres(value)}`);
    sprite.position.set(...(axis === 0 ? [value, beside, 0] : [beside, value, 0]));
    return sprite;
  });
}

const signedMetres = (value) => (Math.abs(value) < 1e-9 ? "0" : value.toFixed(Math.abs(value * 10) % 1 > 1e-6 ? 2 : 1).replace("-", "−"));

function label(text) {
  const { Sprite, SpriteMaterial, CanvasTexture } = MeshCat.THREE;
  const canvas = make("canvas", { width: 192, height: 64 });
  const pen = canvas.getContext("2d");
  pen.font = "600 44px system-ui, sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.lineWidth = 14;
  pen.lineJoin = "round";
  pen.strokeStyle = "#fff";
  pen.strokeText(text, 96, 34);
  pen.fillStyle = "#0b1118";
  pen.fillText(text, 96, 34);
  const sprite = new Sprite(new SpriteMaterial({ map: new CanvasTexture(canvas), depthWrite: false, sizeAttenuation: false }));
  sprite.scale.set(3 * LABEL_SIZE, LABEL_SIZE, 1);
  return sprite;
}

// Twelve bars around the chosen cell.
function createCage() {
  const group = new MeshCat.THREE.Group();
  const half = atlas.map.step / 2;
  const ends = [-half, half];
  const material = flat("#e0301e");
  for (const a of ends) {
    for (const b of ends) {
      group.add(bar([-half, a, b], [half, a, b], BAR_M, material), bar([a, -half, b], [a, half, b], BAR_M, material), bar([a, b, -half], [a, b, half], BAR_M, material));
    }
  }
  return group;
}

// The axes of the chosen pose: x red, y green, z blue, which is where the tool points.
function createFrame() {
  const { Group, Mesh, CylinderGeometry, ConeGeometry } = MeshCat.THREE;
  const frame = new Group();
  const turns = [[0, 0, -Math.PI / 2], [0, 0, 0], [Math.PI / 2, 0, 0]];
  AXES_COLOURS.forEach((colour, axis) => {
    const arrow = new Group();
    const shaft = new Mesh(new CylinderGeometry(ARROW_RADIUS_M, ARROW_RADIUS_M, ARROW_M, 10), flat(colour));
    shaft.position.y = ARROW_M / 2;
    const head = new Mesh(new ConeGeometry(2.6 * ARROW_RADIUS_M, 0.035, 14), flat(colour));
    head.position.y = ARROW_M;
    arrow.add(shaft, head);
    arrow.rotation.set(...turns[axis]);
    frame.add(arrow);
  });
  frame.matrixAutoUpdate = false;
  return frame;
}

// What is drawn of a position: its value from 0 to 1, how wide and how high, in steps; or nothing.
function styleOf(place, k, { height, extent }) {
  const summary = drawn.summary;
  const isCut = k === height;
  if (!isCut && (extent === "slice" || (extent === "below" && k > height))) return null;
  const isReached = summary.reached[place] > 0;
  const value = valueOf(place);
  if (isCut) {
    if (isReached) return { colour: shadeOf(value), width: TILE.width, height: TILE.height };
    if (summary.undecided[place]) return { colour: drawn.undecided, width: UNDECIDED_SIZE, height: TILE.height };
    return { colour: summary.unreachable[place] ? drawn.no : drawn.unknown, width: DOT, height: DOT };
  }
  if (!isReached) return null;
  const least = extent === "whole" ? CUBE.through : CUBE.least; // of the whole map the inside is to be seen
  const size = isOneRotation() ? CUBE.one : least + (CUBE.most - least) * value;
  return { colour: shadeOf(value), width: size, height: size };
}

const isOneRotation = () => drawn.summary.rotations === 1;
const valueOf = (place) => (isOneRotation() ? marginOf(drawn.summary.best[place]) / atlas.topMargin : drawn.summary.reached[place] / drawn.summary.rotations);

function drawCells(choice) {
  const { Matrix4, Color } = MeshCat.THREE;
  const [step, T] = [atlas.map.step, new Matrix4()];
  const isDark = prefersDark.matches;
  Object.assign(drawn, { undecided: new Color(UNDECIDED_COLOUR), no: new Color(isDark ? "#76828f" : "#6a7682"), unknown: new Color(UNKNOWN_COLOUR) });
  drawn.boxes = [];
  const height = choice.cell[2];
  for (let place = 0; place < positions(); place++) {
    const indices = indicesOf(place);
    const style = styleOf(place, indices[2], { height, extent: choice.extent });
    if (!style) continue;
    const [x, y, z] = pointOf(indices);
    T.makeScale(step * style.width, step * style.width, step * style.height).setPosition(x, y, z);
    drawn.cubes.setMatrixAt(drawn.boxes.length, T);
    drawn.cubes.setColorAt(drawn.boxes.length, style.colour);
    const isCut = indices[2] === height;
    drawn.boxes.push({ place, centre: [x, y, z], half: [isCut ? 1 : style.width, isCut ? 1 : style.width, style.height].map((size) => (size * step) / 2) });
  }
  drawn.cubes.count = drawn.boxes.length;
  drawn.cubes.instanceMatrix.needsUpdate = true;
  drawn.cubes.instanceColor.needsUpdate = true;
  drawn.plane.position.z = pointOf([0, 0, height])[2];
  viewer.set_dirty();
}

function drawChosen(cell, rotation) {
  drawn.cage.position.set(...pointOf(cell));
  drawn.frame.visible = rotation !== null;
  if (rotation !== null) drawn.frame.matrix.set(...poseOf(rotation, pointOf(cell)), 0, 0, 0, 1);
  drawn.frame.matrixWorldNeedsUpdate = true;
  viewer.set_dirty();
}

// The first box on the ray through a point of the window; boxes are aligned with base (slabs).
function placeUnder(clientX, clientY) {
  const { Raycaster, Vector2 } = MeshCat.THREE;
  const ray = new Raycaster();
  viewer.camera.updateMatrixWorld();
  ray.setFromCamera(new Vector2((2 * clientX) / window.innerWidth - 1, 1 - (2 * clientY) / window.innerHeight), viewer.camera);
  const [from, along] = [toBase(ray.ray.origin), toBase(ray.ray.direction)];
  let [nearest, found] = [Infinity, null];
  for (const { place, centre, half } of drawn.boxes) {
    let [enter, leave] = [0, nearest];
    for (let axis = 0; axis < 3 && enter <= leave; axis++) {
      const near = (centre[axis] - Math.sign(along[axis]) * half[axis] - from[axis]) / along[axis];
      const far = (centre[axis] + Math.sign(along[axis]) * half[axis] - from[axis]) / along[axis];
      enter = Math.max(enter, near);
      leave = Math.min(leave, far);
    }
    if (enter <= leave && enter < nearest) [nearest, found] = [enter, place];
  }
  return found;
}
