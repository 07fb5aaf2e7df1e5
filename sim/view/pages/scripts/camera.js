// Where the scene is seen from. Points are in the robot's base frame, in metres: x forward, y left,
// z up; three.js has y up and z towards the viewer.
const FIELD_OF_VIEW_DEG = 36;
const FLIGHT_MS = 450;
const FILL = 0.92; // how much of the free area the action may fill
const HAND_RADIUS_M = 0.22;
const CARD_WIDTH = 32; // in the root's font size, as in page.css
const CARD_HEIGHT = 8.2;
const CARD_SHARE = 0.28;
const CARD_GAP_PX = 4; // points have room around them already
const TALL_TOOLS = 0.3; // of the window's height: then they stand in a column, and the scene ends there
const SHARES = Array.from({ length: 9 }, (_, i) => i / 8);
const HEAD_BEFORE_PAN_M = 0.08;
const HEAD_RADIUS_M = 0.16;
const WRIST_TO_TIP_M = 0.2;
const LINK_RADIUS_M = 0.1;
const ZOOM_PER_PIXEL = 0.0012;
const MIN_EYE_M = 0.15;
const MAX_EYE_M = 12;
const TURN_RAD = 0.12;

// From the target towards the eye; of a robot whose right arm alone moves, mirrored.
const VIEWS = {
  fitted: [2.43, 1.71, 0.95],
  front: [1, 0, 0.18],
  side: [0.02, 1, 0.18],
  top: [-0.02, 0, 1],
  hand: [2.2, 1.5, 1.1],
};

const toThree = ([x, y, z]) => new MeshCat.THREE.Vector3(x, z, -y);
const toBase = ({ x, y, z }) => [x, -z, y];

const view = { name: "fitted", isTurned: false, isMirrored: false, points: [], side: "left", last: null, flight: 0, course: [] };

function createCamera() {
  viewer.camera.fov = FIELD_OF_VIEW_DEG;
  viewer.controls.minDistance = MIN_EYE_M;
  viewer.controls.maxDistance = MAX_EYE_M;
  viewer.controls.addEventListener("start", takeOver);
  element("view").addEventListener("wheel", zoomToCursor, { capture: true, passive: false });
  window.addEventListener("resize", () => requestAnimationFrame(refit));
  new ResizeObserver(refit).observe(element("overlay"));
  const render = viewer.render.bind(viewer);
  viewer.render = () => { followHand(); render(); };
  viewer.set_3d_pane_size();
}

// From now on the camera stays where it was put.
function takeOver() {
  view.isTurned = true;
  cancelAnimationFrame(view.flight);
}

function showView(name, { flies = true } = {}) {
  view.name = name;
  view.isTurned = false;
  refit({ flies });
}

// Fit again, unless the user has turned the view; the free area counts in any case.
function refit({ flies = false } = {}) {
  if (!viewer || !view.points.length) return;
  viewer.set_3d_pane_size();
  const [x, y, z] = VIEWS[view.name];
  const back = new MeshCat.THREE.Vector3(x, view.isMirrored ? -y : y, z).normalize();
  const points = view.name === "hand" ? around(handPoint(), HAND_RADIUS_M) : view.points;
  const fits = freeAreas().map((area) => ({ area, ...fit(points, back, area) }));
  const clear = fits.filter(({ isClear }) => isClear);
  const best = (clear.length ? clear : fits).reduce((one, other) => (other.distance < one.distance - 1e-3 ? other : one));
  centreOn(best.area);
  if (view.isTurned) return;
  view.last = toThree(handPoint());
  place(best, flies && !prefersStill.matches);
}

// The closest eye from which all points are seen in the area. In the camera's axes a point at (x, y)
// and z towards the eye is in view when |x - eye.x| <= slope * (eye.z - z), and alike for y.
function fit(points, back, area) {
  const { Vector3 } = MeshCat.THREE;
  const right = new Vector3(0, 0, 1).cross(back).normalize();
  const up = back.clone().cross(right);
  const seen = points.map((p) => new Vector3(...p)).map((p) => [p.dot(right), p.dot(up), p.dot(back)]);
  const slope = Math.tan((FIELD_OF_VIEW_DEG * Math.PI) / 360) / window.innerHeight;
  const [slopeX, slopeY] = [slope * area.width * FILL, slope * area.height * FILL];
  const extent = (i, s) => [Math.max(...seen.map((p) => p[i] + s * p[2])), Math.min(...seen.map((p) => p[i] - s * p[2]))];
  const [x, y] = [extent(0, slopeX), extent(1, slopeY)];
  const depths = seen.map((p) => p[2]);
  const depth = (Math.max(...depths) + Math.min(...depths)) / 2;
  const nearest = Math.max((x[0] - x[1]) / (2 * slopeX), (y[0] - y[1]) / (2 * slopeY), depth + MIN_EYE_M);
  const at = (z) => right.clone().multiplyScalar((x[0] + x[1]) / 2).addScaledVector(up, (y[0] + y[1]) / 2).addScaledVector(back, z);
  const pixels = seen.map((p) => [
    area.left + area.width / 2 + (p[0] - (x[0] + x[1]) / 2) / (nearest - p[2]) / (2 * slope),
    area.top + area.height / 2 - (p[1] - (y[0] + y[1]) / 2) / (nearest - p[2]) / (2 * slope),
  ]);
  const isClear = !pixels.some(([px, py]) => px < area.card.right + CARD_GAP_PX && py < area.card.bottom + CARD_GAP_PX);
  return { eye: toThree(at(nearest).toArray()), target: toThree(at(depth).toArray()), distance: nearest - depth, isClear };
}

// Where nothing covers the scene: below the card, beside it, or partly behind it, which is right when
// no point comes to lie there.
function freeAreas() {
  const [width, height] = [window.innerWidth, window.innerHeight];
  const box = (id) => element(id).getBoundingClientRect();
  const isOpen = !element("panel").hidden;
  const panel = box("panel");
  const isBeside = isOpen && panel.left > 0.3 * width;
  const right = isBeside ? panel.left : width;
  const lowest = [isOpen && !isBeside ? panel : box("hint"), box("controls")].filter((b) => b.height);
  const bottom = Math.min(height, ...lowest.map((b) => b.top));
  const card = cardAtMost(box("title"));
  const tools = box("tools");
  const toolsBottom = tools.left < right ? tools.bottom : 0;
  const end = tools.height > TALL_TOOLS * height ? tools.left : right;
  const area = (left, top) => ({ card, left, top, width: Math.max(end - left, 60), height: Math.max(bottom - top, 60) });
  const [cardRight, cardBottom] = [card.right + CARD_GAP_PX, card.bottom + CARD_GAP_PX];
  return SHARES.flatMap((beside) => SHARES.map((below) => area(beside * cardRight, Math.max(below * cardBottom, toolsBottom))));
}

// The card as large as it mostly gets, so that the view does not depend on its present text.
function cardAtMost({ left, top, right, bottom }) {
  const overlay = element("overlay").getBoundingClientRect();
  const widest = Math.min(left + CARD_WIDTH * rem(), element("tools").getBoundingClientRect().left, overlay.right);
  return { right: Math.max(right, widest), bottom: Math.max(bottom, top + Math.min(CARD_HEIGHT * rem(), CARD_SHARE * overlay.height)) };
}

// The optical axis, around which the view turns, goes through the middle of the free area.
function centreOn({ left, top, width, height }) {
  const [w, h] = [window.innerWidth, window.innerHeight];
  viewer.camera.setViewOffset(w, h, w / 2 - left - width / 2, h / 2 - top - height / 2, w, h);
  viewer.set_dirty();
}

function place({ eye, target }, flies) {
  cancelAnimationFrame(view.flight);
  const { position } = viewer.camera;
  const from = { eye: position.clone(), target: viewer.controls.target.clone() };
  const begin = performance.now();
  view.course = [from.eye, from.target, eye, target];
  const step = (now) => {
    const share = flies ? Math.min(Math.max(now - begin, 0) / FLIGHT_MS, 1) : 1;
    const eased = share * share * (3 - 2 * share);
    position.lerpVectors(from.eye, eye, eased);
    viewer.controls.target.lerpVectors(from.target, target, eased);
    viewer.controls.update();
    viewer.set_dirty();
    if (share < 1) view.flight = requestAnimationFrame(step);
    else view.course = [];
  };
  step(begin);
}

const around = ([x, y, z], r) => [-r, r].flatMap((a) => [-r, r].flatMap((b) => [-r, r].map((c) => [x + a, y + b, z + c])));

function handPoint() {
  const wrist = viewer.scene.getObjectByName(`${view.side}_w2`);
  if (!wrist) return [0.7, 0, 0];
  viewer.scene.updateMatrixWorld();
  return toBase(new MeshCat.THREE.Vector3(0, 0, WRIST_TO_TIP_M).applyMatrix4(wrist.matrixWorld));
}

// In the hand's view the camera goes with the hand, as does a flight to it, and keeps what the user
// has turned.
function followHand() {
  if (view.name !== "hand") return;
  const now = toThree(handPoint());
  if (view.last) {
    const moved = now.clone().sub(view.last);
    for (const point of [viewer.camera.position, viewer.controls.target, ...view.course]) point.add(moved);
  }
  view.last = now;
}

// Everything that the action reaches: moved bodies, and the arms around their joints and tips.
function pointsNow(sides, paths) {
  viewer.scene.updateMatrixWorld();
  const points = [...paths.flatMap(cornersOf), ...sides.flatMap(armPoints)];
  return points.length ? [...points, ...headPoints()] : points;
}

function cornersOf(path) {
  const node = nodeAt(path);
  if (!node || !node.object.visible) return [];
  const { min, max } = new MeshCat.THREE.Box3().setFromObject(node.object);
  if (!(min.x <= max.x)) return [];
  return [min.x, max.x].flatMap((x) => [min.y, max.y].flatMap((y) => [min.z, max.z].map((z) => toBase({ x, y, z }))));
}

function headPoints() {
  const head = viewer.scene.getObjectByName("head_pan");
  if (!head) return [];
  const [x, y, z] = toBase(head.getWorldPosition(new MeshCat.THREE.Vector3()));
  return around([x + HEAD_BEFORE_PAN_M, y, z], HEAD_RADIUS_M);
}

function armPoints(side) {
  const points = [];
  const shoulder = viewer.scene.getObjectByName(`${side}_s0`);
  if (shoulder) shoulder.traverse((node) => { if (/_[sew]\d$/.test(node.name)) points.push(...around(toBase(node.getWorldPosition(new MeshCat.THREE.Vector3())), LINK_RADIUS_M)); });
  view.side = side;
  return shoulder ? [...points, ...around(handPoint(), LINK_RADIUS_M)] : [];
}

function zoomToCursor(event) {
  event.preventDefault();
  event.stopPropagation();
  const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 18 : 1;
  zoom(Math.exp(Math.max(-120, Math.min(event.deltaY * lines, 120)) * ZOOM_PER_PIXEL), pointUnder(event));
}

// Where the ray through the cursor meets the plane of the target across the view.
function pointUnder({ clientX, clientY }) {
  const { Raycaster, Vector2, Vector3, Plane } = MeshCat.THREE;
  const ray = new Raycaster();
  viewer.camera.updateMatrixWorld();
  ray.setFromCamera(new Vector2((2 * clientX) / window.innerWidth - 1, 1 - (2 * clientY) / window.innerHeight), viewer.camera);
  const across = viewer.camera.getWorldDirection(new Vector3());
  const plane = new Plane().setFromNormalAndCoplanarPoint(across, viewer.controls.target);
  return ray.ray.intersectPlane(plane, new Vector3()) || viewer.controls.target.clone();
}

function zoom(factor, centre = viewer.controls.target.clone()) {
  takeOver();
  const { position } = viewer.camera;
  const distance = position.distanceTo(viewer.controls.target);
  const allowed = Math.min(Math.max(factor * distance, MIN_EYE_M), MAX_EYE_M) / distance;
  for (const point of [position, viewer.controls.target]) point.sub(centre).multiplyScalar(allowed).add(centre);
  viewer.set_dirty();
}

// Turn about the target, by the keyboard.
function turn(sideways, upwards) {
  takeOver();
  const { Spherical } = MeshCat.THREE;
  const arm = viewer.camera.position.clone().sub(viewer.controls.target);
  const round = new Spherical().setFromVector3(arm);
  round.theta += sideways * TURN_RAD;
  round.phi = Math.min(Math.max(round.phi - upwards * TURN_RAD, 0.02), Math.PI - 0.02);
  viewer.camera.position.copy(viewer.controls.target).add(arm.setFromSpherical(round));
  viewer.set_dirty();
}

// Buttons and keys of the view, the same on every page.
const VIEW_KEYS = {
  0: () => showView("fitted"),
  1: () => showView("front"),
  2: () => showView("side"),
  3: () => showView("top"),
  4: () => showView("hand"),
  "+": () => zoom(0.85),
  "=": () => zoom(0.85), // the same key without Shift
  "-": () => zoom(1 / 0.85),
  p: () => element("panel-button").click(),
  v: () => element("view-button").click(),
  "?": () => openHelp(),
  Escape: () => openViews(false),
};

const TURN_KEYS = {
  ArrowLeft: () => turn(-1, 0),
  ArrowRight: () => turn(1, 0),
  ArrowUp: () => turn(0, 1),
  ArrowDown: () => turn(0, -1),
};

function openViews(isOpen) {
  if (!isOpen && element("views").contains(document.activeElement)) element("view-button").focus();
  element("views").hidden = !isOpen;
  element("view-button").setAttribute("aria-expanded", isOpen);
}

// Read from its title on, also where Close, which would have the focus, is below the window.
function openHelp() {
  element("help").showModal();
  element("help-title").focus();
}

function listenToView() {
  element("view-button").addEventListener("click", () => openViews(element("views").hidden));
  element("help-button").addEventListener("click", openHelp);
  for (const button of element("views").querySelectorAll("button")) {
    button.addEventListener("click", () => showView(button.value));
  }
  document.addEventListener("pointerdown", ({ target }) => {
    if (!target.closest("#views, #view-button")) openViews(false);
  });
}
