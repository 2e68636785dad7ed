//! `satgs._satgs`: what the Python package calls in the library. It holds no algorithm.
//!
//! `rpc` is the camera, `calls` the commands, `work` runs them beside Python, `files`, `splats`, `mesh` and `scene` give what
//! they read and write as arrays, `error` turns failures into Python's exceptions. The public functions with their signatures and
//! documentation are in the Python files of the folder `satgs`.

mod arrays;
mod calls;
mod error;
mod files;
mod mesh;
mod rpc;
mod scene;
mod splats;
mod work;

use pyo3::prelude::*;

#[pymodule]
fn _satgs(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<rpc::Rpc>()?;
    module.add_class::<scene::SceneView>()?;
    for function in [
        wrap_pyfunction!(calls::call, module)?,
        wrap_pyfunction!(calls::arguments, module)?,
        wrap_pyfunction!(calls::set_threads, module)?,
        wrap_pyfunction!(calls::command, module)?,
        wrap_pyfunction!(files::read_raster, module)?,
        wrap_pyfunction!(files::read_points, module)?,
        wrap_pyfunction!(splats::splat_table, module)?,
        wrap_pyfunction!(splats::write_splats, module)?,
        wrap_pyfunction!(splats::transform_splats, module)?,
        wrap_pyfunction!(splats::render_splats, module)?,
        wrap_pyfunction!(scene::read_scene, module)?,
        wrap_pyfunction!(mesh::read_mesh, module)?,
        wrap_pyfunction!(mesh::write_mesh, module)?,
        wrap_pyfunction!(mesh::fuse_depths, module)?,
    ] {
        module.add_function(function)?;
    }
    Ok(())
}
