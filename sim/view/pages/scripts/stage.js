"use strict";
// What all scripts of the page share: the elements, Meshcat's viewer with its own panel hidden, day
// and night, and the message when nothing can be drawn.
const element = (id) => document.getElementById(id);
const prefersDark = matchMedia("(prefers-color-scheme: dark)");
const prefersStill = matchMedia("(prefers-reduced-motion: reduce)");

const BACKGROUND = { light: [[0.95, 0.96, 0.98], [0.78, 0.82, 0.86]], dark: [[0.15, 0.17, 0.20], [0.07, 0.08, 0.10]] };
const FLOOR = { light: 0xffffff, dark: 0x565d66 }; // multiplies the floor's own grey

// By path, what to do again after a command has changed what is drawn there.
const painters = { "/floor": paintStage, "/Background": paintStage };

let viewer;

function createViewer() {
  const made = new MeshCat.Viewer(element("view"));
  made.gui.domElement.style.display = "none";
  made.renderer.domElement.setAttribute("role", "img");
  made.renderer.domElement.setAttribute("aria-label", "The robot and what is around it, drawn in 3D");
  handleContextLoss(made);
  const handle = made.handle_command.bind(made);
  made.handle_command = (command) => {
    handle(command);
    if (painters[command.path]) painters[command.path](made);
  };
  paintStage(made);
  return made;
}

// A browser may lose the graphics card, as after sleep, and mostly gets it back.
function handleContextLoss(made) {
  const canvas = made.renderer.domElement;
  let before = "";
  canvas.addEventListener("webglcontextlost", () => {
    before = element("status").textContent;
    showStatus("The browser has stopped drawing in 3D. It goes on by itself, or once this page is loaded again.");
  });
  canvas.addEventListener("webglcontextrestored", () => {
    showStatus(before);
    made.set_dirty();
  });
}

// The node of a path, if it exists.
function nodeAt(path) {
  const names = path.split("/").filter(Boolean);
  return names.reduce((node, name) => node && node.children[name], viewer.scene_tree);
}

const drawnAt = (node) => node && node.children["<object>"] && node.children["<object>"].object;

const rem = () => parseFloat(getComputedStyle(document.documentElement).fontSize);

const cssColour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function paintStage(made) {
  const [top, bottom] = BACKGROUND[prefersDark.matches ? "dark" : "light"];
  const background = made.scene_tree.find(["Background"]);
  background.set_property("top_color", top);
  background.set_property("bottom_color", bottom);
  background.on_update();
  const floor = drawnAt(made.scene_tree.children.floor);
  if (floor) floor.material.color.setHex(FLOOR[prefersDark.matches ? "dark" : "light"]);
  made.set_dirty();
}

// A page's content is compressed msgpack; Meshcat's decoder is reached by letting its viewer decode a
// command and keep the result instead of drawing it.
async function decode(base64) {
  if (!window.DecompressionStream) throw new Error("the browser is older than 2023 and cannot unpack it. Try a newer one.");
  const compressed = new Blob([Uint8Array.from(atob(base64), (c) => c.charCodeAt(0))]);
  const unpacked = compressed.stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(unpacked).arrayBuffer());
  let decoded;
  const reader = Object.create(MeshCat.Viewer.prototype);
  reader.handle_command = (value) => { decoded = value; };
  reader.handle_command_bytearray(bytes);
  return unpack(decoded);
}

// Geometries drawn more than once are stored once, by name.
function draw(commands, geometries) {
  for (const command of commands) {
    if (command.type === "set_object") {
      command.object.geometries = command.object.geometries.map((g) => geometries[g.uuid] || g);
    }
    viewer.handle_command(command);
  }
}

// Start once "Loading" is visible, and show a message when the browser cannot draw.
function startWith(start) {
  const attempt = async () => {
    if (!canDraw()) return showProblem("This page draws in 3D with WebGL, which is switched off or missing in this browser. Try another browser, or turn on its hardware acceleration.");
    try { await start(); } catch (error) { showProblem(`This page cannot be shown: ${error.message}`); throw error; }
  };
  requestAnimationFrame(() => setTimeout(attempt));
}

function canDraw() {
  const canvas = document.createElement("canvas");
  return Boolean(canvas.getContext("webgl2") || canvas.getContext("webgl"));
}

function showProblem(text) {
  element("problem").textContent = text;
  document.body.classList.add("failed");
}

function write(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

function make(tag, properties = {}, ...children) {
  const node = Object.assign(document.createElement(tag), properties);
  node.append(...children);
  return node;
}

// The number of ascending times that have passed.
function countUntil(times, time) {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time + 1e-9) low = middle + 1;
    else high = middle;
  }
  return low;
}

// Screen readers announce the time after a pause or a jump, and nothing while it plays.
const ANNOUNCE_AFTER_MS = 400;
let announcing;
function announce(text) {
  clearTimeout(announcing);
  announcing = setTimeout(() => write(element("announcer"), text), ANNOUNCE_AFTER_MS);
}
