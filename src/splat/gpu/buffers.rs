//! Arrays in the memory of a device.

use super::device::GpuDevice;
use crate::splat::backend::GpuError;
use std::sync::mpsc::channel;
use std::time::Duration;
use wgpu::BufferUsages;

/// Smallest size of an array, bytes: that of the largest record, also where there are no values.
const LEAST_BYTES: u64 = 64;

impl GpuDevice {
    /// An array of words, zero at first.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub(super) fn array(&self, what: &'static str, words: u64) -> Result<wgpu::Buffer, GpuError> {
        self.array_for(what, words, BufferUsages::STORAGE)
    }

    /// As [`GpuDevice::array`], with the sizes of dispatches.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub(super) fn sizes(&self, what: &'static str, words: u64) -> Result<wgpu::Buffer, GpuError> {
        self.array_for(what, words, BufferUsages::STORAGE | BufferUsages::INDIRECT)
    }

    /// As [`GpuDevice::array`], for the numbers that all lanes read.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`].
    pub(super) fn uniform(&self, what: &'static str, words: u64) -> Result<wgpu::Buffer, GpuError> {
        self.array_for(what, words, BufferUsages::UNIFORM)
    }

    fn array_for(
        &self,
        what: &'static str,
        words: u64,
        usage: BufferUsages,
    ) -> Result<wgpu::Buffer, GpuError> {
        let (bytes, limit) = (4 * words, self.info.largest_binding.min(self.info.largest_buffer));
        if bytes > limit {
            return Err(GpuError::TooLarge { what, bytes, device: self.info.name.clone(), limit });
        }
        let usage = usage | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let descriptor = wgpu::BufferDescriptor {
            label: Some(what),
            size: bytes.max(LEAST_BYTES),
            usage,
            mapped_at_creation: false,
        };
        Ok(self.device.create_buffer(&descriptor))
    }

    /// Writes words to the beginning of an array, before everything that is submitted later.
    pub(super) fn write(&self, to: &wgpu::Buffer, words: &[u32]) {
        self.queue.write_buffer(to, 0, bytemuck::cast_slice(words));
    }

    /// As [`GpuDevice::write`].
    pub(super) fn write_numbers(&self, to: &wgpu::Buffer, numbers: &[f32]) {
        self.queue.write_buffer(to, 0, bytemuck::cast_slice(numbers));
    }

    /// An array that the processor reads.
    pub(super) fn staging(&self, words: u64) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("staging"),
            size: (4 * words).max(LEAST_BYTES),
            usage: BufferUsages::MAP_READ | BufferUsages::COPY_DST,
            mapped_at_creation: false,
        })
    }

    /// The first words of an array, after everything that was submitted.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub(super) fn read(&self, from: &wgpu::Buffer, words: usize) -> Result<Vec<u32>, GpuError> {
        if words == 0 {
            return Ok(Vec::new());
        }
        let staging = self.staging(words as u64);
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(from, 0, &staging, 0, 4 * words as u64);
        self.queue.submit([encoder.finish()]);
        self.read_staging(&staging, words)
    }

    /// The first words of an array that the device writes in what was submitted.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub(super) fn read_staging(&self, staging: &wgpu::Buffer, words: usize) -> Result<Vec<u32>, GpuError> {
        let failed = |reason: String| GpuError::Failed { device: self.info.name.clone(), reason };
        let (sender, receiver) = channel();
        let slice = staging.slice(..4 * words as u64);
        slice.map_async(wgpu::MapMode::Read, move |result| {
            let _ = sender.send(result);
        });
        self.wait()?;
        let mapped = receiver.recv().map_err(|e| failed(e.to_string()))?;
        mapped.map_err(|e| failed(e.to_string()))?;
        let view = slice.get_mapped_range().map_err(|e| failed(e.to_string()))?;
        let out = bytemuck::pod_collect_to_vec(&view);
        drop(view);
        staging.unmap();
        Ok(out)
    }

    /// As [`GpuDevice::read`], of numbers.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub(super) fn read_numbers(&self, from: &wgpu::Buffer, count: usize) -> Result<Vec<f32>, GpuError> {
        Ok(bytemuck::cast_vec(self.read(from, count)?))
    }

    /// Room for so many times.
    ///
    /// # Errors
    /// [`GpuError::Lacks`].
    pub(super) fn timestamps(&self, count: u32) -> Result<wgpu::QuerySet, GpuError> {
        if !self.device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return Err(GpuError::Lacks {
                device: self.info.name.clone(),
                missing: "times of kernels".into(),
            });
        }
        let descriptor = wgpu::QuerySetDescriptor { label: None, ty: wgpu::QueryType::Timestamp, count };
        Ok(self.device.create_query_set(&descriptor))
    }

    /// Times since the first of all, as the device wrote them.
    ///
    /// # Errors
    /// [`GpuError::Failed`].
    pub(super) fn read_timestamps(
        &self,
        from: &wgpu::QuerySet,
        count: u32,
    ) -> Result<Vec<Duration>, GpuError> {
        let resolved = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("times"),
            size: 8 * u64::from(count),
            usage: BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.resolve_query_set(from, 0..count, &resolved, 0);
        self.queue.submit([encoder.finish()]);
        let words = self.read(&resolved, 2 * count as usize)?;
        let ticks: Vec<u64> = words
            .as_chunks()
            .0
            .iter()
            .map(|[low, high]| u64::from(*high) << u32::BITS | u64::from(*low))
            .collect();
        let (first, period) =
            (ticks.first().copied().unwrap_or(0), f64::from(self.queue.get_timestamp_period()));
        let since = |tick: u64| Duration::from_nanos((tick.saturating_sub(first) as f64 * period) as u64);
        Ok(ticks.into_iter().map(since).collect())
    }
}
