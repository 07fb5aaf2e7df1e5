// The line between the two that are nearest to each other, and the layers that can be switched.
const NEAREST = "/nearest"; // a cylinder along y, of radius 1 and length 1
const NEAREST_RADIUS_M = 0.004;

const layers = { list: [], chosen: new Map() };

function paintNearest(made) {
  const drawn = drawnAt(made.scene_tree.children.nearest);
  if (drawn) drawn.material.color.set(cssColour("--nearest"));
}

painters[NEAREST] = paintNearest;

function showNearest(nearest) {
  const chip = element("nearest-chip");
  write(chip, nearest ? `nearest: ${millimetres(nearest.distance)}, ${pairText(nearest)}` : "");
  chip.title = nearest ? pairText(nearest) : "";
  const node = nodeAt(NEAREST);
  if (!node) return;
  const length = nearest ? placeBetween(node.object, nearest.points) : 0;
  node.object.visible = length > 0 && isShown("nearest");
}

// Returns how long the line is; one of no length has no direction either.
function placeBetween(object, points) {
  const { Vector3 } = MeshCat.THREE;
  const [from, to] = [new Vector3(...points.slice(0, 3)), new Vector3(...points.slice(3))];
  const length = from.distanceTo(to);
  if (!(length > 1e-6)) return 0;
  object.position.copy(from).add(to).multiplyScalar(0.5);
  object.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), to.sub(from).divideScalar(length));
  object.scale.set(NEAREST_RADIUS_M, length, NEAREST_RADIUS_M);
  return length;
}

const millimetres = (metres) => `${signed(1000 * metres, Math.abs(metres) < 0.1 ? 1 : 0)} mm`;
const pairText = ({ first, second }) => `${first} and ${second}`;

const isShown = (id) => {
  const layer = layers.list.find((one) => one.id === id);
  return layers.chosen.has(id) ? layers.chosen.get(id) : !layer || layer.shown;
};

function showLayers(list) {
  const isNew = list.map((layer) => layer.id).join() !== layers.list.map((layer) => layer.id).join();
  layers.list = list;
  if (isNew) element("layers").replaceChildren(...list.map(layerBox));
  element("layered").hidden = list.length === 0;
  list.forEach(applyLayer);
}

function layerBox({ id, label, shown }) {
  const box = make("input", { type: "checkbox", id: `layer-${id}`, checked: layers.chosen.has(id) ? layers.chosen.get(id) : shown });
  box.addEventListener("change", () => {
    layers.chosen.set(id, box.checked);
    applyLayer(layers.list.find((layer) => layer.id === id));
  });
  return make("label", {}, box, ` ${label}`);
}

// What is drawn anew below a switched layer, or in its place, is as the layer is.
function applyLayersTo(node) {
  const isBelow = (path) => node === path || node.startsWith(`${path}/`);
  layers.list.filter(({ paths }) => paths.some((path) => path !== NEAREST && isBelow(path))).forEach(applyLayer);
}

function applyLayer({ id, paths }) {
  for (const path of paths) {
    if (path === NEAREST) showNearest(clearanceAt(panelTime()));
    else viewer.handle_command({ type: "set_property", path, property: "visible", value: isShown(id) });
  }
  viewer.set_dirty();
}
