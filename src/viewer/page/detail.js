// Splats from coarse to fine: their first file is drawn at once, the others follow as long as pictures are drawn fast.

// A picture that takes longer, in milliseconds, gets more detail only when somebody asks for it.
const SLOW_PICTURE = 500;

const splatMesh = async (file, read) => {
  const mesh = new L.SplatMesh({ fileBytes: await read(file), fileName: file, extSplats: true });
  await mesh.initialized;
  return mesh;
};

const pause = (ms) => new Promise((done) => setTimeout(done, ms));
const countOf = (layer) => layer.object.children.reduce((sum, mesh) => sum + mesh.extSplats.numSplats, 0);

// Splats are sorted apart from the pictures; until then the ones before are shown.
const untilSorted = async (layer) => {
  const drawing = layer.of ? otherSpark : spark;
  while (layer.object.visible && layer.object.parent && (drawing.sorting || drawing.display.numSplats < countOf(layer))) {
    redraw();
    await pause(30);
  }
};

// The time of a picture. Graphics cards work on while the program goes on: only what is read is complete.
const pictureTime = () => {
  const began = performance.now();
  render();
  readPixels(0, 0, 1, 1);
  return performance.now() - began;
};

const showDetail = (layer) => {
  if (layer.of) return;
  const shown = countOf(layer);
  root.dataset.splats = shown;
  layer.line.querySelector("small").textContent = shown < layer.count ? `${shown.toLocaleString("fr")} of ${layer.note}` : layer.note;
};

const addDetail = async (layer) => {
  const more = $("more");
  for (const file of layer.files.slice(1)) {
    await untilSorted(layer);
    if (pictureTime() > SLOW_PICTURE) {
      more.hidden = false;
      await new Promise((asked) => more.addEventListener("click", asked, { once: true }));
      more.hidden = true;
    }
    if (!layer.object.parent) return;
    try {
      layer.object.add(await splatMesh(file, layer.read));
    } catch (error) {
      // While a run trains, the next checkpoint may have taken the place of this one.
      if (run.live) return;
      throw error;
    }
    showDetail(layer);
    if (chosen("tint") === "height") tintSplats();
    redraw();
  }
  await untilSorted(layer);
  if (!layer.of) root.dataset.detail = "all";
};
