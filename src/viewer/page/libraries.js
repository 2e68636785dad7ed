// What the page takes from its libraries: three.js (rendering) and Spark (Gaussian splats).
export {
  AmbientLight, Box3, BufferAttribute, BufferGeometry, Color, DataUtils, DirectionalLight, DoubleSide, Float32BufferAttribute, Group,
  Line, LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial, MeshLambertMaterial, PerspectiveCamera, Points,
  PointsMaterial, Raycaster, Scene, SRGBColorSpace, Texture, Vector2, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
export { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
export { PLYLoader } from "three/addons/loaders/PLYLoader.js";
export { dyno, SparkRenderer, SplatMesh } from "@sparkjsdev/spark";
