// Where rays meet splats: at the depth at which half of their light is absorbed.

// Splats are transparent beyond so many standard deviations.
const SPLAT_REACH = 3;

// How far each splat of a mesh reaches from its centre. Spark keeps logarithms of scales in half precision.
const reaches = new WeakMap();
let scaleOfHalf = null;
const reachesOf = (mesh) => {
  if (!reaches.has(mesh)) {
    scaleOfHalf ??= Float32Array.from({ length: 65536 }, (_, bits) => Math.exp(L.DataUtils.fromHalfFloat(bits)));
    const shapes = mesh.extSplats.extArrays[1];
    const reach = new Float32Array(mesh.extSplats.numSplats);
    for (let i = 0; i < reach.length; i++) {
      const [x, yz] = [shapes[4 * i + 1] >>> 16, shapes[4 * i + 2]];
      reach[i] = SPLAT_REACH * Math.max(scaleOfHalf[x], scaleOfHalf[yz & 65535], scaleOfHalf[yz >>> 16]);
    }
    reaches.set(mesh, reach);
  }
  return reaches.get(mesh);
};
const centersOf = (mesh) => new Float32Array(mesh.extSplats.extArrays[0].buffer);

// Where a ray meets a splat, in lengths of its direction, and how much of the light the splat absorbs there.
const [from, along] = [new L.Vector3(), new L.Vector3()];
const meet = (mesh, i, origin, direction) => {
  const { center, scales, quaternion, opacity } = mesh.extSplats.getSplat(i);
  const turn = quaternion.conjugate();
  from.copy(origin).sub(center).applyQuaternion(turn).divide(scales);
  along.copy(direction).applyQuaternion(turn).divide(scales);
  const t = -from.dot(along) / along.lengthSq();
  return { t, alpha: opacity * Math.exp(-0.5 * from.addScaledVector(along, t).lengthSq()) };
};
const depthOf = (hits) => {
  let light = 1;
  return hits.sort((a, b) => a.t - b.t).find(({ alpha }) => (light *= 1 - alpha) < 0.5)?.t ?? NaN;
};

// The distance at which a ray of the scene meets a layer of splats; NaN where it passes through.
const splatDistance = (layer, ray) => {
  const hits = [];
  for (const mesh of layer.object.children) {
    const { origin, direction } = ray.clone().applyMatrix4(mesh.matrixWorld.clone().invert());
    const [centers, reach] = [centersOf(mesh), reachesOf(mesh)];
    for (let i = 0; i < reach.length; i++) {
      const [x, y, z] = [centers[4 * i] - origin.x, centers[4 * i + 1] - origin.y, centers[4 * i + 2] - origin.z];
      const t = x * direction.x + y * direction.y + z * direction.z;
      if (t < 0 || x * x + y * y + z * z - t * t > reach[i] * reach[i]) continue;
      hits.push(meet(mesh, i, origin, direction));
    }
  }
  return depthOf(hits);
};

// Altitudes of a layer of splats, as seen from above, at evenly spaced places of a level line of the scene; NaN where there are none.
const splatAltitudes = (layer, from, to, count) => {
  const step = to.clone().sub(from).setZ(0).divideScalar(count - 1);
  const length = step.length();
  const hits = Array.from({ length: count }, () => []);
  for (const mesh of layer.object.children) {
    const inside = mesh.matrixWorld.clone().invert();
    const [start, down] = [from.clone().applyMatrix4(inside), new L.Vector3(0, 0, -1).transformDirection(inside)];
    const along = step.clone().transformDirection(inside);
    const across = down.clone().cross(along);
    const [centers, reach, at] = [centersOf(mesh), reachesOf(mesh), new L.Vector3()];
    for (let i = 0; i < reach.length; i++) {
      at.fromArray(centers, 4 * i).sub(start);
      if (Math.abs(at.dot(across)) > reach[i]) continue;
      const [middle, around] = [at.dot(along) / length, reach[i] / length];
      const last = Math.min(Math.floor(middle + around), count - 1);
      for (let k = Math.max(Math.ceil(middle - around), 0); k <= last; k++) {
        hits[k].push(meet(mesh, i, start.clone().addScaledVector(along, k * length), down));
      }
    }
  }
  return hits.map((found) => from.z - depthOf(found));
};
