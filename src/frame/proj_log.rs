//! The messages that PROJ would print.

use std::sync::Once;

/// Keeps PROJ from printing to the standard error: an error of the library says what failed. Contexts inherit this from PROJ's
/// default context, so that it must come before the first of them.
#[allow(unsafe_code)]
pub(super) fn silence() {
    static SILENCED: Once = Once::new();
    // SAFETY: a null pointer means the default context; `Once` keeps threads from changing it at the same time.
    SILENCED.call_once(|| unsafe {
        proj_sys::proj_log_level(std::ptr::null_mut(), proj_sys::PJ_LOG_LEVEL_PJ_LOG_NONE);
    });
}
