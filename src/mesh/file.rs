//! Mesh files of all formats.

use super::{MeshError, TriangleMesh};
use super::{glb, obj, ply, ply_writer};
use crate::frame::SiteGrid;
use crate::io::{WriteError, read_georeference, remove_if_there, write_file, write_georeference};
use std::path::Path;

/// A format of mesh files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Stanford PLY, `.ply`.
    Ply,
    /// Wavefront OBJ, `.obj`.
    Obj,
    /// Binary glTF 2.0, `.glb`.
    Glb,
}

impl MeshFormat {
    /// The format in which a file of this name can be written.
    ///
    /// # Errors
    /// [`MeshError::Ending`].
    pub fn of_output(path: &Path) -> Result<Self, MeshError> {
        let (action, endings) = ("written", ".ply, .obj or .glb");
        Self::of(path).ok_or_else(|| MeshError::Ending { path: path.into(), action, endings })
    }

    /// The format of a file of this name.
    fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "ply" => Some(Self::Ply),
            "obj" => Some(Self::Obj),
            "glb" => Some(Self::Glb),
            _ => None,
        }
    }
}

impl TriangleMesh {
    /// Reads a PLY (binary little-endian or ascii) or OBJ file, and its georeference if one is beside it. Polygons become
    /// triangles.
    ///
    /// # Errors
    /// [`MeshError`] if the file cannot be read, is damaged, holds no triangles, or a vertex is not finite.
    pub fn read(path: &Path) -> Result<Self, MeshError> {
        let wrong = |reason: String| MeshError::Format { path: path.into(), reason };
        let parse = match MeshFormat::of(path) {
            Some(MeshFormat::Ply) => ply::parse,
            Some(MeshFormat::Obj) => obj::parse,
            _ => {
                let (action, endings) = ("read", ".ply or .obj");
                return Err(MeshError::Ending { path: path.into(), action, endings });
            }
        };
        let bytes = std::fs::read(path).map_err(|e| wrong(e.to_string()))?;
        let mut mesh = parse(&bytes).map_err(wrong)?;
        mesh.site = read_georeference(path)?;
        // Normals that were not computed are no normals.
        if mesh.normals.iter().flatten().any(|v| !v.is_finite()) {
            mesh.normals.clear();
        }
        if let Some((i, p)) = mesh.vertices.iter().enumerate().find(|(_, p)| p.iter().any(|v| !v.is_finite()))
        {
            return Err(wrong(format!("vertex {i} is not finite: {}, {}, {}", p[0], p[1], p[2])));
        }
        let count = mesh.vertices.len();
        if let Some((i, t)) =
            mesh.triangles.iter().enumerate().find(|(_, t)| t.iter().any(|v| *v as usize >= count))
        {
            return Err(wrong(format!("face {i} names vertices {t:?}, but there are {count}")));
        }
        if mesh.triangles.is_empty() {
            return Err(MeshError::NoTriangles { path: path.into(), vertices: count });
        }
        Ok(mesh)
    }

    /// Reads the vertices of a PLY file, which needs no faces, and the georeference if one is beside it.
    ///
    /// # Errors
    /// [`MeshError`] if the file cannot be read or is damaged.
    pub fn read_vertices(path: &Path) -> Result<(Vec<[f64; 3]>, Option<SiteGrid>), MeshError> {
        let wrong = |reason: String| MeshError::Format { path: path.into(), reason };
        let bytes = std::fs::read(path).map_err(|e| wrong(e.to_string()))?;
        Ok((ply::parse(&bytes).map_err(wrong)?.vertices, read_georeference(path)?))
    }

    /// Writes the mesh in the format of the file's name, and its georeference beside it.
    ///
    /// # Errors
    /// [`MeshError::Ending`] for an unknown ending, [`MeshError::FileSize`] if the format cannot hold the mesh,
    /// [`MeshError::Write`] if a file cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), MeshError> {
        let bytes = match MeshFormat::of_output(path)? {
            MeshFormat::Ply => ply_writer::bytes(self),
            MeshFormat::Obj => obj::bytes(self),
            MeshFormat::Glb => glb::bytes(self).ok_or_else(|| MeshError::FileSize { path: path.into() })?,
        };
        write_file(path, bytes)?;
        Ok(self.write_place(path)?)
    }

    fn write_place(&self, path: &Path) -> Result<(), WriteError> {
        match &self.site {
            Some(site) => write_georeference(path, site),
            // That of an earlier file of this name would be wrong.
            None => remove_if_there(&path.with_extension("georef.json")),
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::frame::{Point, SiteGrid};

    /// A tetrahedron with colours and normals.
    pub fn tetrahedron() -> TriangleMesh {
        TriangleMesh {
            vertices: vec![[0.0, 0.0, 0.0], [1.5, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.5]],
            colors: vec![[0, 128, 255], [255, 0, 0], [10, 20, 30], [255; 3]],
            normals: vec![[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
            ..TriangleMesh::default()
        }
    }

    #[test]
    fn ply_and_obj_are_read_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.ply", "b.obj", "C.PLY"] {
            let path = folder.path().join(name);
            for site in
                [Some(SiteGrid { epsg: 32617, origin: Point::new(436_211.0, 3_357_611.5, -20.0) }), None]
            {
                let mesh = TriangleMesh { site, ..tetrahedron() };
                mesh.write(&path).unwrap();
                assert_eq!(TriangleMesh::read(&path).unwrap(), mesh, "{name}");
                assert_eq!(path.with_extension("georef.json").exists(), site.is_some());
            }
        }
    }

    #[test]
    fn coordinates_of_a_map_keep_their_millimetres() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.ply", "b.obj"] {
            let path = folder.path().join(name);
            let mut mesh = tetrahedron();
            mesh.vertices[1] = [436_211.123, 3_357_611.456, 1.0];
            mesh.write(&path).unwrap();
            assert_eq!(TriangleMesh::read(&path).unwrap().vertices, mesh.vertices);
        }
    }

    #[test]
    fn other_names_are_refused() {
        for name in ["mesh", "mesh.stl", "mesh.glb"] {
            let says = TriangleMesh::read(Path::new(name)).unwrap_err().to_string();
            assert!(says.contains("is not the name of a mesh that can be read"), "{says}");
        }
        assert!(tetrahedron().write(Path::new("mesh.stl")).is_err());
    }
}
