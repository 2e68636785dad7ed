// A run that trains: the splats of each checkpoint take the place of the ones before.

// How often it asks for a new checkpoint, in milliseconds.
const ASK_EVERY = 1000;

// The loss on a logarithmic scale, from the first iteration to now.
const lossCurve = (losses) => {
  const levels = losses.map((v) => Math.log(Math.max(v, 1e-9)));
  const [low, high] = [Math.min(...levels), Math.max(...levels)];
  const points = levels.map((v, k) => `${((100 * k) / (losses.length - 1 || 1)).toFixed(1)} ${(2 + (20 * (high - v)) / (high - low || 1)).toFixed(1)}`);
  return `<path d="M${points.join("L")}"/>`;
};

const showTraining = ({ iteration, iterations, losses }) => {
  const isTraining = losses.length > 0;
  $("training").hidden = false;
  const done = isTraining ? `Iteration ${iteration} of ${iterations}, loss ${losses.at(-1).toFixed(4)}` : "Training is complete";
  $("training").querySelector("span").textContent = root.dataset.training = done;
  $("training").querySelector("svg").innerHTML = isTraining ? lossCurve(losses) : "";
};

// Puts a new layer where the one of its kind was.
const replaceLayer = async (next) => {
  const before = layers.find((l) => l.kind === next.kind);
  next.object = await made(next, bytesOf);
  if (!before) return addLayer(next);
  next.line = before.line;
  next.object.visible = before.object.visible;
  before.object.removeFromParent();
  world.add(next.object);
  layers[layers.indexOf(before)] = next;
  // The old splats are drawn until the new ones are sorted.
  if (next.kind === "splats") {
    showDetail(next);
    await untilSorted(next);
    before.object.children.forEach((mesh) => mesh.dispose());
    addDetail(next);
  }
};

const followTraining = async () => {
  let { version } = run.live;
  showTraining(run.live);
  for (;;) {
    await pause(ASK_EVERY);
    try {
      const now = await (await fetch("run.json")).json();
      if (now.live.version === version) continue;
      // Cameras and points stay as they are.
      const isNew = (l) => l.kind === "splats" || !layers.some((own) => own.kind === l.kind);
      for (const layer of now.layers.filter(isNew)) await replaceLayer(layer);
      version = now.live.version;
      showTraining(now.live);
      tintSplats();
      showColors();
      root.dataset.version = version;
    } catch (error) {
      // The server has ended, or a newer checkpoint was written meanwhile.
      console.info(String(error));
    }
  }
};

// Starts the page; once more where a newer checkpoint replaced the splats while they were loaded. Other failures stay on the page.
const begin = () =>
  start().catch((error) => {
    if (!run.live || error.cause !== 404) throw error;
    setTimeout(() => location.reload(), ASK_EVERY);
  });
