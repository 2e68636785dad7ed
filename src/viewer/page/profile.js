// The heights along the line between two measured points: a graph, and a table to take away.

const PROFILE_PLACES = 240;
const PROFILE_COLORS = { relief: "#6fc3ff", splats: "#ffb347" };
let profile = null;

// Heights of every layer that has some, at evenly spaced places of a line of the scene.
const profileOf = (a, b) => {
  const along = Array.from({ length: PROFILE_PLACES }, (_, k) => a.clone().lerp(b, k / (PROFILE_PLACES - 1)));
  const lines = [];
  for (const layer of [...layers, ...otherLayers]) {
    const line = { name: nameOf(layer), color: PROFILE_COLORS[layer.kind], isOther: Boolean(layer.of) };
    if (layer.kind === "relief") lines.push({ ...line, heights: along.map((p) => reliefHeight(layer, p)) });
    if (layer.kind === "splats") {
      lines.push({ ...line, heights: splatAltitudes(layer, a, b, PROFILE_PLACES).map((z) => z + run.origin[2]) });
    }
  }
  const length = Math.hypot(b.x - a.x, b.y - a.y);
  return { places: along.map((p, k) => [(k / (PROFILE_PLACES - 1)) * length, ...map(p).slice(0, 2)]), lines };
};

const profileTable = ({ places, lines }) => {
  const unit = run.isOnMap ? "_m" : "";
  const head = ["distance", run.isOnMap ? "easting" : "x", run.isOnMap ? "northing" : "y", ...lines.map((l) => l.name.toLowerCase().replace(/[^a-z0-9]+/g, "_"))];
  const number = (v) => (Number.isNaN(v) ? "" : v.toFixed(3));
  const rows = places.map((place, k) => [...place, ...lines.map((l) => l.heights[k])].map(number).join(","));
  return [head.map((name) => name + unit).join(","), ...rows, ""].join("\n");
};

const drawProfile = ({ places, lines }) => {
  const [width, height, left, bottom] = [250, 110, 34, 16];
  const known = lines.flatMap((l) => l.heights).filter((z) => !Number.isNaN(z));
  const [low, high] = [Math.min(...known), Math.max(...known)];
  const length = places.at(-1)[0];
  const x = (s) => left + ((width - left - 4) * s) / (length || 1);
  const y = (z) => 6 + ((height - bottom - 10) * (high - z)) / (high - low || 1);
  const path = ({ heights, color, isOther }) => {
    const isKnown = (k) => k >= 0 && !Number.isNaN(heights[k]);
    const points = heights.map((z, k) => (isKnown(k) ? `${isKnown(k - 1) ? "L" : "M"}${x(places[k][0]).toFixed(1)} ${y(z).toFixed(1)}` : ""));
    return `<path d="${points.join("")}" stroke="${color}"${isOther ? ' stroke-dasharray="3 2"' : ""}/>`;
  };
  const text = (at, up, anchor, words) => `<text x="${at}" y="${up}" text-anchor="${anchor}">${words}</text>`;
  const unit = run.isOnMap ? " m" : "";
  $("graph").setAttribute("viewBox", `0 0 ${width} ${height}`);
  $("graph").innerHTML = known.length
    ? `<path class="frame" d="M${left} 2V${height - bottom}H${width}"/>${lines.map(path).join("")}` +
      text(left - 4, 10, "end", high.toFixed(1)) + text(left - 4, height - bottom, "end", low.toFixed(1)) +
      text(left, height - 3, "middle", "A") + text(width, height - 3, "end", `B, ${length.toFixed(1)}${unit}`)
    : text(left, 20, "start", "no heights");
  $("keys").replaceChildren(...lines.map(({ name, color }) => {
    const key = document.createElement("span");
    key.textContent = name;
    key.style.setProperty("--c", color);
    return key;
  }));
};

const showProfile = (marks) => {
  $("profile").hidden = marks.length < 2;
  if (marks.length < 2) return;
  profile = profileOf(...marks);
  drawProfile(profile);
};

const saveText = (name, text) => {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
  link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
};
