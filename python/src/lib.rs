//! `satgs._satgs`: what the Python package calls in the library. It holds no algorithm.
//!
//! `rpc` is the camera, `calls` has one function for each call of `satgs::pipeline`, `options` reads their keyword
//! arguments, `work` runs them beside Python, `error` turns failures into Python's exceptions. The public functions with
//! their signatures and documentation are in the Python files of the folder `satgs`.

mod calls;
mod error;
mod options;
mod rpc;
mod work;

use pyo3::prelude::*;

#[pymodule]
fn _satgs(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<rpc::Rpc>()?;
    for function in [
        wrap_pyfunction!(calls::adjust, module)?,
        wrap_pyfunction!(calls::train, module)?,
        wrap_pyfunction!(calls::dsm, module)?,
        wrap_pyfunction!(calls::compare, module)?,
        wrap_pyfunction!(calls::run, module)?,
        wrap_pyfunction!(calls::set_threads, module)?,
        wrap_pyfunction!(calls::command, module)?,
    ] {
        module.add_function(function)?;
    }
    Ok(())
}
