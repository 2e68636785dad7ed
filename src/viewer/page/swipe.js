// Two runs in one picture: this one to the left of a divider, the other one to the right.

// A scene of the other run, which lies where it is on the map.
const otherScene = new L.Scene();
const otherWorld = new L.Group();
const otherLayers = [];
let otherSpark = null;
// The share of the picture to the left of the divider; all of it without another run.
let divider = 1;

// The kinds of layers that are shown of both runs.
const COMPARED = ["splats", "relief", "mesh"];

const addOther = async ({ title, offset, prefix, layers: theirs }) => {
  otherScene.background = scene.background;
  otherSpark = new L.SparkRenderer({ renderer, onDirty: redraw, accumExtSplats: true });
  otherWorld.quaternion.copy(world.quaternion);
  otherWorld.position.copy(turned(offset));
  otherScene.add(otherSpark, otherWorld, ...[ambient, sun].map((light) => light.clone()));
  for (const layer of theirs.filter((l) => COMPARED.includes(l.kind))) {
    layer.object = await made(layer, (name) => bytesOf(prefix + name));
    layer.of = title;
    otherWorld.add(layer.object);
    otherLayers.push(layer);
  }
  $("sides").hidden = $("divider").hidden = false;
  $("sides").firstChild.textContent = run.title;
  $("sides").lastChild.textContent = title;
  moveDivider(0.5);
  showOther();
  otherLayers.filter((l) => l.kind === "splats").forEach(addDetail);
  root.dataset.other = otherLayers.map((l) => l.kind).join(" ");
};

// Layers of the other run are shown as those of the same kind of this one.
const showOther = () => {
  for (const layer of otherLayers) {
    const own = layers.find((l) => l.kind === layer.kind);
    layer.object.visible = own ? own.object.visible : layer.isShown;
  }
};

const moveDivider = (share) => {
  divider = Math.min(Math.max(share, 0.02), 0.98);
  $("divider").style.left = $("sides").style.left = `${100 * divider}%`;
  $("divider").setAttribute("aria-valuenow", Math.round(100 * divider));
  redraw();
};

const isOtherSide = ({ clientX }) => otherLayers.length > 0 && clientX > divider * innerWidth;

const render = () => {
  if (!otherLayers.length) return renderer.render(scene, camera);
  const left = Math.round(divider * innerWidth);
  renderer.setScissorTest(true);
  renderer.setScissor(0, 0, left, innerHeight);
  renderer.render(scene, camera);
  renderer.setScissor(left, 0, innerWidth - left, innerHeight);
  otherScene.add(drawn);
  renderer.render(otherScene, camera);
  scene.add(drawn);
  renderer.setScissorTest(false);
};

$("divider").addEventListener("pointerdown", (event) => $("divider").setPointerCapture(event.pointerId));
$("divider").addEventListener("pointermove", (event) => event.buttons && moveDivider(event.clientX / innerWidth));
$("divider").addEventListener("keydown", ({ key }) => {
  const step = { ArrowLeft: -0.02, ArrowRight: 0.02 }[key];
  if (step) moveDivider(divider + step);
});
