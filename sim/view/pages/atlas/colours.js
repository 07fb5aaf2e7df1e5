// Colours of values from 0 to 1: viridis (Smith and van der Walt 2015), which is perceptually uniform
// and the same order of lightness to people with colour blindness.
const VIRIDIS = ["#440154", "#481a6c", "#472f7d", "#414487", "#39568c", "#31688e", "#2a788e", "#23888e", "#1f988b", "#22a884", "#35b779", "#54c568", "#7ad151", "#a5db36", "#d2e21b", "#fde725"];
const UNDECIDED_COLOUR = "#d81b8c";
const UNKNOWN_COLOUR = "#e07f05"; // not computed

function colourOf(value) {
  const at = Math.min(Math.max(value, 0), 1) * (VIRIDIS.length - 1);
  const before = Math.min(Math.floor(at), VIRIDIS.length - 2);
  const [from, to] = [VIRIDIS[before], VIRIDIS[before + 1]].map((text) => new MeshCat.THREE.Color(text));
  return from.lerp(to, at - before);
}

// A table, so that cells by the thousand are coloured at once.
const SHADES = 128;
let shades;
const shadeOf = (value) => {
  shades = shades || Array.from({ length: SHADES }, (_, i) => colourOf(i / (SHADES - 1)));
  return shades[Math.round(Math.min(Math.max(value, 0), 1) * (SHADES - 1))];
};

function showLegend(words, ticks) {
  element("scale").style.background = `linear-gradient(to right, ${VIRIDIS.join(", ")})`;
  write(element("quantity"), words);
  element("ticks").replaceChildren(...ticks.map((text) => make("span", { textContent: text })));
}
