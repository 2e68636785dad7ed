// Heights as colours.

// Viridis of Matplotlib, from low to high.
const HEIGHT_COLORS = [0x440154, 0x3b528b, 0x21918c, 0x5ec962, 0xfde725];

// The heights below which 2 % of these lie and above which 2 % do, as in dsm.qml.
const heightEnds = (heights) => {
  const sorted = heights.filter((z) => !Number.isNaN(z)).sort();
  return [0.02, 0.98].map((share) => sorted[Math.floor(share * sorted.length)] ?? 0);
};

// Colours of heights between two ends, for the vertices of a surface.
const heightColors = (heights, [low, high]) => {
  const stops = HEIGHT_COLORS.map(color);
  const colors = new Float32Array(3 * heights.length);
  const mixed = new L.Color();
  heights.forEach((z, i) => {
    const place = (Math.min(Math.max((z - low) / (high - low || 1), 0), 1) || 0) * (stops.length - 1);
    const k = Math.min(Math.floor(place), stops.length - 2);
    mixed.copy(stops[k]).lerp(stops[k + 1], place - k).toArray(colors, 3 * i);
  });
  return colors;
};

// The upward direction in the coordinates of the run.
const upward = () => new L.Vector3(0, 0, 1).applyQuaternion(world.quaternion.clone().invert());

// Altitudes of the centres of splats: of the first part, which is a sample of all.
const splatCenterAltitudes = (layer) => {
  const [mesh, { x, y, z }] = [layer.object.children[0], upward()];
  const centers = centersOf(mesh);
  return Float32Array.from({ length: mesh.extSplats.numSplats }, (_, i) => centers[4 * i] * x + centers[4 * i + 1] * y + centers[4 * i + 2] * z);
};

// What gives splats the colours of their altitudes on the graphics card.
const splatsByHeight = ([low, high]) => {
  const number = (v) => v.toExponential(8);
  const vector = (v) => `vec3(${v.map(number).join(", ")})`;
  const stops = HEIGHT_COLORS.map((c) => vector([c >> 16, (c >> 8) & 255, c & 255].map((v) => v / 255)));
  const splat = { gsplat: L.dyno.Gsplat };
  return L.dyno.dynoBlock(splat, splat, ({ gsplat }) => new L.dyno.Dyno({
    inTypes: splat,
    outTypes: splat,
    statements: ({ inputs, outputs }) => [`
      ${outputs.gsplat} = ${inputs.gsplat};
      {
        vec3 stops[${stops.length}] = vec3[${stops.length}](${stops.join(", ")});
        float share = (dot(${inputs.gsplat}.center, ${vector(upward().toArray())}) - ${number(low)}) / ${number(high - low || 1)};
        float place = clamp(share, 0.0, 1.0) * ${number(stops.length - 1)};
        int k = min(int(place), ${stops.length - 2});
        ${outputs.gsplat}.rgba.rgb = mix(stops[k], stops[k + 1], place - float(k));
      }`],
  }).apply({ gsplat }));
};
