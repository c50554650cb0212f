// What is drawn can be switched off, layer by layer.

const CROWD = 12; // with more robots than this, the belief chart shows a band instead of all lines
const isCrowd = robots.length > CROWD;

const LAYERS = [
  ["paths", "paths"], ["samples", "samples"], ["rays", "rays"], ["messages", "messages"],
  ...(run.places ? [["places", "believed places"]] : []),
  ...(run.maps ? [["map", "believed map"]] : []),
  ...(isCrowd ? [["lines", "line of each robot"]] : []),
];
const OFF_AT_FIRST = ["lines"];
const layers = Object.fromEntries(LAYERS.map(([name]) => [name, !OFF_AT_FIRST.includes(name)]));

function buildLayers(onChange) {
  byId("layers").append(...LAYERS.map(([name, words]) => {
    const box = make("input", "");
    box.type = "checkbox";
    box.id = `layer-${name}`;
    box.checked = layers[name];
    box.addEventListener("change", () => {
      layers[name] = box.checked;
      onChange(name);
    });
    return make("label", "layer", box, words);
  }));
}
