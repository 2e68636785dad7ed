//! `satgs info --devices`.

use super::{CliError, Ui};
use crate::splat::gpu::{DeviceInfo, devices};
use serde_json::{Value, json};

/// Shows the devices that drivers offer.
pub fn run(ui: &Ui) -> Result<(), CliError> {
    let devices = devices();
    let text = match &devices[..] {
        [] => "no driver of Vulkan, Metal or DX12 offers a device".to_owned(),
        devices => devices.iter().map(line).collect::<Vec<_>>().join("\n"),
    };
    ui.summary("info", Some(&text), &json!({ "devices": devices.iter().map(summary).collect::<Vec<_>>() }))
}

fn line(device: &DeviceInfo) -> String {
    let DeviceInfo { number, name, driver, interface, kind, largest_binding, missing, .. } = device;
    let gigabytes = *largest_binding as f64 / 1e9;
    let can = if missing.is_empty() { String::new() } else { format!("; lacks {}", missing.join(", ")) };
    format!("gpu:{number}: {name} ({kind}; {interface}, {driver}), arrays of at most {gigabytes:.2} GB{can}")
}

fn summary(device: &DeviceInfo) -> Value {
    json!({
        "number": device.number,
        "name": device.name,
        "kind": device.kind.to_string(),
        "interface": device.interface,
        "driver": device.driver,
        "largest_binding_bytes": device.largest_binding,
        "largest_buffer_bytes": device.largest_buffer,
        "missing": device.missing,
    })
}
