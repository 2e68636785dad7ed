// The page of `satgs view`: layers of a run in the site frame (metres east, north, up from the site's origin), drawn with
// three.js and Spark, which `libraries` holds. Positions on the graphics card are f32; the origin is added to them in f64.
"use strict";

const L = libraries;
const run = JSON.parse(document.getElementById("run").textContent);
const root = document.documentElement;
const $ = (id) => document.getElementById(id);

// What went wrong is shown, and can be read from the page's root element.
const failures = [];
const fail = (text) => {
  failures.push(text);
  root.dataset.failures = failures.join("\n");
  $("state").textContent = text;
};
addEventListener("error", (event) => fail(event.message));
addEventListener("unhandledrejection", (event) => fail(String(event.reason?.message ?? event.reason)));
const log = console.error;
console.error = (...words) => (log(...words), fail(words.join(" ")));

// The bytes of a file of the page: part of the page itself, or from the server that sent it.
const bytesOf = async (name) => {
  const inside = document.getElementById("file:" + name);
  if (inside) {
    const bytes = Uint8Array.from(atob(inside.textContent.trim()), (c) => c.charCodeAt(0));
    inside.remove();
    return bytes;
  }
  const answer = await fetch(name);
  if (!answer.ok) throw new Error(`${name}: ${answer.status} ${answer.statusText}`, { cause: answer.status });
  return new Uint8Array(await answer.arrayBuffer());
};

// ---- The stage

let renderer;
try {
  renderer = new L.WebGLRenderer({ antialias: false, powerPreference: "high-performance" });
} catch {
  throw new Error("This browser has no WebGL 2, which the page needs.");
}
renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
$("view").append(renderer.domElement);
const scene = new L.Scene();
scene.background = new L.Color(0x12171e);
const camera = new L.PerspectiveCamera(40, 1, 1, 1e5);
camera.up.set(0, 0, 1);
const controls = new L.OrbitControls(camera, renderer.domElement);
controls.zoomToCursor = true;
controls.screenSpacePanning = false;

// Frames are drawn when something has changed.
let isStale = true;
const redraw = () => (isStale = true);
controls.addEventListener("change", redraw);
let hasTurned = false;
controls.addEventListener("start", () => (hasTurned = true));
// Centres as f32: half-precision ones would be off by decimetres.
const spark = new L.SparkRenderer({ renderer, onDirty: redraw, accumExtSplats: true });
const ambient = new L.AmbientLight(0xffffff, 0.9);
scene.add(spark, ambient);
// From the north-west, as on maps.
const sun = new L.DirectionalLight(0xffffff, 2.6);
sun.position.set(-0.5, 0.5, 0.7);
scene.add(sun);

// Everything of the run stands in one group, which turns its upward direction to z.
const world = new L.Group();
world.quaternion.setFromUnitVectors(new L.Vector3(...run.up).normalize(), new L.Vector3(0, 0, 1));
world.updateMatrixWorld();
scene.add(world);
const turned = (place) => new L.Vector3(...place).applyQuaternion(world.quaternion);
const middle = turned(run.middle);
const { radius } = run;

// Looks at a point from a direction, azimuth clockwise from north and elevation, degrees.
const lookFrom = (azimuth, elevation, target = middle, distance = radius * 3) => {
  const [a, e] = [azimuth, elevation].map((v) => (v * Math.PI) / 180);
  controls.target.copy(target);
  camera.position.set(Math.sin(a) * Math.cos(e), Math.cos(a) * Math.cos(e), Math.sin(e)).multiplyScalar(distance).add(target);
  controls.update();
  redraw();
};

// ---- Layers

const color = (sRgb) => new L.Color(sRgb);

// Colours of the numbers of views, as in report.html: fewer than two (filled in), two, three, four or more; not known.
const VIEW_COLORS = [0xe69f00, 0xa6cee3, 0x5696d6, 0x084594].map(color);
const NOT_KNOWN = color(0xbebebe);
const viewColors = (views) => {
  const colors = new Float32Array(3 * views.length);
  views.forEach((n, i) => (n === 255 ? NOT_KNOWN : VIEW_COLORS[Math.min(Math.max(n - 1, 0), 3)]).toArray(colors, 3 * i));
  return colors;
};

const makers = {
  async splats({ files }, read) {
    return new L.Group().add(await splatMesh(files[0], read));
  },

  async relief({ file, texture, views, columns, rows, west, north, cell }, read) {
    const heights = new Float32Array((await read(file)).buffer);
    const positions = new Float32Array(3 * columns * rows);
    const places = new Float32Array(2 * columns * rows);
    for (let i = 0; i < heights.length; i++) {
      const [col, row] = [i % columns, Math.floor(i / columns)];
      positions.set([west + (col + 0.5) * cell, north - (row + 0.5) * cell, heights[i]], 3 * i);
      places.set([(col + 0.5) / columns, 1 - (row + 0.5) / rows], 2 * i);
    }
    const triangles = [];
    for (let row = 1; row < rows; row++) {
      for (let col = 1; col < columns; col++) {
        const d = row * columns + col;
        const [a, b, c] = [d - columns - 1, d - columns, d - 1];
        for (const t of [[a, c, b], [b, c, d]]) {
          if (t.every((i) => !Number.isNaN(heights[i]))) triangles.push(...t);
        }
      }
    }
    // A vertex without height is in no triangle, but boxes and normals are computed from all.
    for (let i = 2; i < positions.length; i += 3) if (Number.isNaN(positions[i])) positions[i] = run.middle[2];
    const shape = new L.BufferGeometry();
    shape.setAttribute("position", new L.BufferAttribute(positions, 3));
    shape.setAttribute("uv", new L.BufferAttribute(places, 2));
    shape.setIndex(triangles);
    shape.computeVertexNormals();
    const shaded = new L.MeshLambertMaterial({ color: 0xc9c4ba, side: L.DoubleSide });
    const ends = heightEnds(heights);
    const byHeight = heightColors(heights, ends);
    const byViews = views && viewColors(await read(views));
    shape.setAttribute("color", new L.BufferAttribute(byHeight, 3));
    const colored = new L.MeshLambertMaterial({ vertexColors: true, side: L.DoubleSide });
    let draped = shaded;
    if (texture) {
      const picture = new L.Texture(await createImageBitmap(new Blob([await read(texture)]), { imageOrientation: "flipY" }));
      Object.assign(picture, { colorSpace: L.SRGBColorSpace, flipY: false, needsUpdate: true, anisotropy: 8 });
      draped = new L.MeshBasicMaterial({ map: picture, side: L.DoubleSide });
    }
    const mesh = new L.Mesh(shape, draped);
    $("colors").addEventListener("change", ({ target }) => {
      mesh.material = { shade: shaded, height: colored, views: colored, ortho: draped }[target.value];
      shape.setAttribute("color", new L.BufferAttribute(target.value === "views" ? byViews : byHeight, 3));
      $("counts").hidden = target.value !== "views";
      redraw();
    });
    // Comparing a ray with every triangle would take too long under a moving pointer: it is followed over the grid.
    shape.computeBoundingBox();
    const heightAt = (x, y) => {
      const [c, r] = [(x - west) / cell - 0.5, (north - y) / cell - 0.5];
      const [col, row] = [Math.floor(c), Math.floor(r)];
      if (!(col >= 0 && row >= 0 && col < columns - 1 && row < rows - 1)) return NaN;
      const [u, v, i] = [c - col, r - row, row * columns + col];
      const line = (k) => heights[k] * (1 - u) + heights[k + 1] * u;
      return line(i) * (1 - v) + line(i + columns) * v;
    };
    Object.assign(mesh.userData, { heightAt, ends });
    mesh.raycast = (from, hits) => {
      const ray = from.ray.clone().applyMatrix4(mesh.matrixWorld.clone().invert());
      const [box, at] = [shape.boundingBox, new L.Vector3()];
      const inside = box.containsPoint(ray.origin) ? ray.origin : ray.intersectBox(box, new L.Vector3());
      if (!inside) return;
      const above = (t) => ray.at(t, at).z - heightAt(at.x, at.y);
      const [first, step] = [inside.distanceTo(ray.origin), cell / 2];
      const last = first + box.getSize(new L.Vector3()).length();
      for (let t = first, before = NaN; t < last; t += step) {
        const now = above(t);
        if (before >= 0 && now < 0) {
          let [high, low] = [t - step, t];
          for (let k = 0; k < 12; k++) above((high + low) / 2) >= 0 ? (high = (high + low) / 2) : (low = (high + low) / 2);
          hits.push({ distance: low, point: mesh.localToWorld(ray.at(low, new L.Vector3())), object: mesh });
          return;
        }
        before = now;
      }
    };
    return mesh;
  },

  async mesh({ file, offset }, read) {
    const bytes = (await read(file)).buffer;
    const group = new L.Group();
    if (file.endsWith(".glb")) {
      const gltf = await new L.GLTFLoader().parseAsync(bytes, "");
      // glTF has y up. A mesh of `satgs mesh` has the run's axes and a node that turns them; other files are turned to z up.
      const nodes = [];
      gltf.scene.traverse((node) => nodes.push(node));
      if (nodes.some((node) => node.userData.axes === "run")) nodes.forEach((node) => node.quaternion.identity());
      else gltf.scene.rotation.x = Math.PI / 2;
      group.add(gltf.scene);
    } else {
      const shape = new L.PLYLoader().parse(bytes);
      if (!shape.getAttribute("normal")) shape.computeVertexNormals();
      const material = shape.getAttribute("color")
        ? new L.MeshBasicMaterial({ vertexColors: true, side: L.DoubleSide })
        : new L.MeshLambertMaterial({ color: 0xb9c3cf, side: L.DoubleSide });
      group.add(new L.Mesh(shape, material));
    }
    group.position.set(...offset);
    return group;
  },

  async points({ file, count }, read) {
    const bytes = await read(file);
    const shape = new L.BufferGeometry();
    shape.setAttribute("position", new L.BufferAttribute(new Float32Array(bytes.buffer, 0, 3 * count), 3));
    const linear = Float32Array.from({ length: 256 }, (_, v) => new L.Color().setRGB(v / 255, 0, 0, L.SRGBColorSpace).r);
    const colors = Float32Array.from(bytes.subarray(12 * count), (v) => linear[v]);
    shape.setAttribute("color", new L.BufferAttribute(colors, 3));
    return new L.Points(shape, new L.PointsMaterial({ size: 3, sizeAttenuation: false, vertexColors: true }));
  },

  async cameras({ views }) {
    const [positions, colors] = [[], []];
    const line = (a, b, c) => (positions.push(...a, ...b), colors.push(...c, ...c));
    for (const { at, corners, to, isTest } of views) {
      const c = color(isTest ? 0x6fc3ff : 0xffb347).toArray();
      const faint = c.map((v) => v * 0.3);
      corners.forEach((corner, k) => {
        line(at, corner, c);
        line(corner, corners[(k + 1) % corners.length], c);
      });
      if (to) line(at, to, faint);
    }
    const shape = new L.BufferGeometry();
    shape.setAttribute("position", new L.Float32BufferAttribute(positions, 3));
    shape.setAttribute("color", new L.Float32BufferAttribute(colors, 3));
    return new L.LineSegments(shape, new L.LineBasicMaterial({ vertexColors: true }));
  },
};

const made = (layer, read) => makers[layer.kind](Object.assign(layer, { read }), read);

const layers = [];
const addLayer = (layer) => {
  const box = document.createElement("input");
  Object.assign(box, { type: "checkbox", checked: layer.isShown, name: layer.kind });
  box.addEventListener("change", () => {
    layers.find((l) => l.kind === layer.kind).object.visible = box.checked;
    showOther();
    showColors();
    redraw();
  });
  const label = document.createElement("label");
  const count = document.createElement("small");
  count.textContent = layer.note;
  label.append(box, layer.label, count);
  $("layers").append(label);
  layer.line = label;
  layer.object.visible = layer.isShown;
  world.add(layer.object);
  layers.push(layer);
};
const chosen = (name) => document.querySelector(`[type=radio][name=${name}]:checked`).value;
const showColors = () => {
  $("tints").hidden = !visible("splats").length;
  $("colors").hidden = !visible("relief").length;
  const isByHeight = (kind, name) => visible(kind).length && chosen(name) === "height";
  $("heights").hidden = !(isByHeight("relief", "relief") || isByHeight("splats", "tint"));
  if (!$("heights").hidden) heightRange().forEach((z, k) => ($("heights").children[k + 1].textContent = metres(z + run.origin[2]).slice(0, -1) + (run.isOnMap ? " m" : "")));
  $("colors").querySelector("[value=ortho]").parentElement.hidden = !visible("relief").some((l) => l.texture);
  $("colors").querySelector("[value=views]").parentElement.hidden = !visible("relief").some((l) => l.views);
  $("named").hidden = !visible("cameras").length;
};
// The altitudes at the ends of the colours: of the surface model, else of the splats.
const heightRange = () => {
  const relief = layers.find((l) => l.kind === "relief");
  return relief ? relief.object.userData.ends : heightEnds(splatCenterAltitudes(layers.find((l) => l.kind === "splats")));
};
const tintSplats = () => {
  const modifier = chosen("tint") === "height" ? splatsByHeight(heightRange()) : undefined;
  for (const mesh of [...layers, ...otherLayers].filter((l) => l.kind === "splats").flatMap((l) => l.object.children)) {
    mesh.objectModifier = modifier;
    mesh.updateGenerator();
  }
  redraw();
};
$("tints").addEventListener("change", () => (tintSplats(), showColors()));
$("colors").addEventListener("change", () => showColors());
const shownOf = (all, kinds) => all.filter((l) => kinds.includes(l.kind) && l.object.visible);
const visible = (...kinds) => shownOf(layers, kinds);

// ---- Places: what is under the pointer, and map coordinates

const nameOf = (layer) => (layer.of ? `${layer.label} of ${layer.of}` : layer.label);
const map = (place) => world.worldToLocal(place.clone()).toArray().map((v, k) => v + run.origin[k]);
const metres = (v) => (Math.abs(v) < 0.005 ? 0 : v).toFixed(2).replace("-", "\u2212");

const pick = (event) => {
  const frame = renderer.domElement.getBoundingClientRect();
  const at = new L.Vector2(
    ((event.clientX - frame.left) / frame.width) * 2 - 1,
    1 - ((event.clientY - frame.top) / frame.height) * 2,
  );
  const ray = new L.Raycaster();
  ray.setFromCamera(at, camera);
  const side = isOtherSide(event) ? otherLayers : layers;
  const hits = shownOf(side, ["mesh", "relief"]).flatMap((layer) => ray.intersectObject(layer.object, true).map((hit) => ({ ...hit, layer })));
  for (const layer of shownOf(side, ["splats"])) {
    const distance = splatDistance(layer, ray.ray);
    if (!Number.isNaN(distance)) hits.push({ distance, point: ray.ray.at(distance, new L.Vector3()), layer });
  }
  const hit = hits.reduce((a, b) => (a && a.distance <= b.distance ? a : b), null);
  return hit && { point: hit.point, on: hit.layer };
};

// The height of a surface model at a place of the scene; NaN where it has none.
const reliefHeight = ({ object }, place) => {
  const [x, y] = object.parent.worldToLocal(place.clone()).toArray();
  return object.localToWorld(new L.Vector3(x, y, object.userData.heightAt(x, y))).z + run.origin[2];
};

// The camera whose picture of itself is near the pointer.
const cameraAt = (event) => {
  const size = new L.Vector2(innerWidth, innerHeight);
  const near = ({ at }) => {
    const p = turned(at).project(camera);
    if (p.z > 1) return Infinity;
    return Math.hypot(((p.x + 1) / 2) * size.x - event.clientX, ((1 - p.y) / 2) * size.y - event.clientY);
  };
  const views = visible("cameras").flatMap((l) => l.views);
  const best = views.reduce((a, b) => (a && near(a) <= near(b) ? a : b), null);
  return best && near(best) < 12 ? best : null;
};

let pointer = null;
renderer.domElement.addEventListener("pointermove", (event) => (pointer = event.buttons ? null : event));
renderer.domElement.addEventListener("pointerleave", ({ pointerType }) => pointerType === "mouse" && (pointer = null));
// A tap is no click on what appears under the finger.
renderer.domElement.addEventListener("touchend", (event) => event.cancelable && event.preventDefault());
const showPlace = () => {
  if (!pointer) return;
  const view = cameraAt(pointer);
  $("hint").hidden = !view;
  if (view) {
    $("hint").textContent = view.name + (view.isTest ? " (held back)" : "");
    Object.assign($("hint").style, { left: `${pointer.clientX}px`, top: `${pointer.clientY}px` });
  }
  renderer.domElement.style.cursor = view ? "pointer" : "crosshair";
  const found = pick(pointer);
  $("place").replaceChildren();
  if (found) {
    const [e, n, h] = map(found.point).map(metres);
    const frame = document.createElement("small");
    const relief = (found.on.of ? otherLayers : layers).find((l) => l.kind === "relief");
    const surface = relief && found.on.kind === "splats" ? reliefHeight(relief, found.point) : NaN;
    const beside = Number.isNaN(surface) ? "" : `DSM ${metres(surface)} m`;
    // Heights of splats are as fine as what is shown of them.
    const share = found.on.kind === "splats" ? countOf(found.on) / found.on.count : 1;
    const part = share < 1 ? ` (${Math.round(100 * share)} % of them)` : "";
    frame.textContent = [nameOf(found.on) + part, beside, run.frame].filter(Boolean).join(", ");
    $("place").append(run.isOnMap ? `E ${e}   N ${n}   height ${h} m` : `x ${e}   y ${n}   z ${h}`, frame);
  }
  pointer = null;
};
// Often enough for the eye, and no more of the time than a quarter: the ray is compared with every splat and triangle.
const followPointer = () => {
  const began = performance.now();
  showPlace();
  setTimeout(followPointer, Math.max(120, 3 * (performance.now() - began)));
};

// Names beside the cameras, as far as they do not cover each other.
const showNames = () => {
  const isAsked = $("named").querySelector("input").checked;
  const [taken, names] = [[], []];
  for (const { at, name } of isAsked ? visible("cameras").flatMap((l) => l.views) : []) {
    const p = turned(at).project(camera);
    if (p.z > 1 || Math.abs(p.x) > 1 || Math.abs(p.y) > 1) continue;
    const [x, y] = [((p.x + 1) / 2) * innerWidth, ((1 - p.y) / 2) * innerHeight];
    const wide = 7 * name.length + 12;
    if (taken.some((t) => x < t.x + t.wide && t.x < x + wide && Math.abs(y - t.y) < 16)) continue;
    taken.push({ x, y, wide });
    const label = document.createElement("span");
    label.textContent = name;
    Object.assign(label.style, { left: `${x}px`, top: `${y}px` });
    names.push(label);
  }
  $("names").replaceChildren(...names);
};
$("named").addEventListener("change", redraw);

// ---- Measuring

// Width of a phone, as in page.css.
const NARROW = 520;

const marks = [];
const drawn = new L.Group();
drawn.renderOrder = 10;
scene.add(drawn);
const showMeasure = () => {
  drawn.clear();
  const over = { depthTest: false, depthWrite: false, transparent: true };
  if (marks.length) {
    const shape = new L.BufferGeometry().setFromPoints(marks);
    const [a, b] = marks;
    drawn.add(new L.Points(shape, new L.PointsMaterial({ size: 9, sizeAttenuation: false, color: 0xffb347, ...over })));
    if (b) {
      // Level from A to below or above B, then upright.
      const path = new L.BufferGeometry().setFromPoints([a, b, new L.Vector3(b.x, b.y, a.z), a]);
      drawn.add(new L.Line(path, new L.LineBasicMaterial({ color: 0xffb347, ...over })));
    }
    for (const part of drawn.children) part.renderOrder = 10;
  }
  $("measure").hidden = $("clear").hidden = !marks.length;
  // On a small screen the panel would hide where the second point is.
  if (marks.length > Number(innerWidth <= NARROW)) $("panel").open = true;
  $("panel").classList.toggle("measuring", marks.length > 0);
  for (const [k, name] of ["a", "b"].entries()) {
    const place = marks[k] ? map(marks[k]).map(metres) : ["", "", ""];
    ["e", "n", "h"].forEach((axis, i) => ($(name + axis).textContent = place[i]));
  }
  const [a, b] = marks;
  const unit = run.isOnMap ? " m" : "";
  $("unit").textContent = run.isOnMap ? "metres" : "";
  $("rise").textContent = b ? metres(b.z - a.z) + unit : "";
  $("level").textContent = b ? metres(Math.hypot(b.x - a.x, b.y - a.y)) + unit : "";
  $("slant").textContent = b ? metres(a.distanceTo(b)) + unit : "";
  showProfile(marks);
  redraw();
};

let pressed = null;
renderer.domElement.addEventListener("pointerdown", (event) => (pressed = event.button === 0 ? event : null));
renderer.domElement.addEventListener("pointerup", (event) => {
  const isClick = pressed && Math.hypot(event.clientX - pressed.clientX, event.clientY - pressed.clientY) < 4;
  pressed = null;
  if (!isClick) return;
  pointer = event;
  const view = cameraAt(event);
  if (view) {
    const at = turned(view.at);
    const base = view.corners.map(turned).reduce((sum, c) => sum.add(c), new L.Vector3()).divideScalar(view.corners.length);
    const ahead = base.sub(at).setLength(radius);
    controls.target.copy(view.to ? turned(view.to) : at.clone().add(ahead));
    camera.position.copy(at);
    controls.update();
    redraw();
    return;
  }
  const found = pick(event);
  if (!found) return;
  if (marks.length === 2) marks.length = 0;
  marks.push(found.point);
  showMeasure();
});
const clearMeasure = () => {
  marks.length = 0;
  showMeasure();
};
addEventListener("keydown", ({ key }) => key === "Escape" && clearMeasure());
$("clear").addEventListener("click", clearMeasure);
$("save").addEventListener("click", () => saveText(`${run.title}-profile.csv`, profileTable(profile)));

// ---- Drawing

const resize = () => {
  renderer.setSize(innerWidth, innerHeight);
  camera.aspect = innerWidth / innerHeight;
  camera.updateProjectionMatrix();
  redraw();
};
addEventListener("resize", resize);

const showFrame = () => {
  const towards = controls.target.clone().sub(camera.position);
  // With the camera straight above, what is up in the image tells where north is.
  const up = new L.Vector3().setFromMatrixColumn(camera.matrixWorld, 1);
  const azimuth = Math.atan2(towards.x + up.x * radius * 1e-3, towards.y + up.y * radius * 1e-3);
  $("north").style.transform = `rotate(${-azimuth}rad)`;
  const perPixel = (2 * towards.length() * Math.tan((camera.fov * Math.PI) / 360)) / innerHeight;
  const longest = 120 * perPixel;
  const power = 10 ** Math.floor(Math.log10(longest));
  const length = power * [5, 2, 1].find((k) => k * power <= longest);
  $("scale").firstChild.style.width = `${length / perPixel}px`;
  $("scale").lastChild.textContent = `${Number(length.toPrecision(1))}${run.isOnMap ? " m" : ""}`;
};

// Pixels of the picture that was rendered last.
const readPixels = (x, y, w, h) => {
  const gl = renderer.getContext();
  const pixels = new Uint8Array(4 * w * h);
  // Spark reads pixels into a buffer of its own at any time.
  const bound = gl.getParameter(gl.PIXEL_PACK_BUFFER_BINDING);
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
  gl.readPixels(x, y, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  gl.bindBuffer(gl.PIXEL_PACK_BUFFER, bound);
  return pixels;
};

// The share of the canvas that is drawn on.
const coverage = () => {
  const { drawingBufferWidth: w, drawingBufferHeight: h } = renderer.getContext();
  const pixels = readPixels(0, 0, w, h);
  const isDrawn = (i) => Math.abs(pixels[i] - 0x12) + Math.abs(pixels[i + 1] - 0x17) > 6 && pixels[i + 3] > 0;
  let n = 0;
  for (let i = 0; i < pixels.length; i += 4) n += isDrawn(i);
  return n / (w * h);
};

// The first picture is of the splats alone: what takes time beside them is read when it is shown.
const LONGEST_WAIT = 10000;
let firstPicture;
const isDrawn = new Promise((done) => (firstPicture = done));
const animate = () => {
  requestAnimationFrame(animate);
  if (!isStale) return;
  isStale = false;
  const distance = camera.position.distanceTo(controls.target);
  const reach = camera.position.distanceTo(middle) + 4 * radius;
  camera.near = Math.max(distance / 200, reach / 1e5);
  camera.far = reach;
  camera.updateProjectionMatrix();
  render();
  // Splats appear when they are sorted, some frames after they are read.
  if (layers.length && !root.dataset.coverage) {
    const share = spark.display.numSplats ? coverage() : 0;
    if (share > 0) {
      Object.assign(root.dataset, { coverage: share.toFixed(4), firstPicture: Math.round(performance.now()) });
      firstPicture();
    } else redraw();
  }
  showFrame();
  showNames();
};

// The whole scene, from the south; farther away if cameras that are shown would lie outside of the picture.
const lookHome = () => {
  const views = visible("cameras").flatMap((l) => l.views);
  const isOutside = ({ at }) => {
    const p = turned(at).project(camera);
    return p.z > 1 || Math.max(Math.abs(p.x), Math.abs(p.y)) > 0.95;
  };
  // A narrow picture shows less to the sides.
  for (let distance = radius * 3 * Math.max(1, 0.85 / camera.aspect), k = 0; k < 24; k++, distance *= 1.15) {
    lookFrom(180, 45, middle, distance);
    camera.far = distance + 8 * radius;
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
    if (!views.some(isOutside)) break;
  }
};

const start = async () => {
  document.title = $("title").textContent = run.title;
  $("north").style.display = run.isOnMap ? "" : "none";
  resize();
  lookHome();
  $("panel").open = innerWidth > NARROW;
  $("home").addEventListener("click", lookHome);
  $("top").addEventListener("click", () => lookFrom(180, 89.99));
  animate();
  followPointer();
  for (const layer of run.layers) {
    $("state").textContent = `Loading ${layer.label}`;
    await new Promise((done) => setTimeout(done));
    layer.object = await made(layer, bytesOf);
    addLayer(layer);
    redraw();
    if (layer.kind === "splats") {
      showDetail(layer);
      $("state").textContent = "";
      await Promise.race([isDrawn, pause(LONGEST_WAIT)]);
    }
  }
  if (!failures.length) $("state").textContent = "";
  showColors();
  // Unless somebody has looked around meanwhile.
  if (!hasTurned) lookHome();
  redraw();
  isDrawn.then(() => (root.dataset.state = "drawn"));
  layers.filter((l) => l.kind === "splats").forEach(addDetail);
  if (run.other) await addOther(run.other);
  if (run.live) followTraining();
};
