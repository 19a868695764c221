//! The time that each pass takes on the device.

use crate::compiled::Device;

/// Maximum number of passes that are timed in one frame.
const SPANS: u32 = 16;

/// Time stamps around passes. Records nothing on devices without time-stamp queries.
pub struct Timer {
    queries: Option<Queries>,
    names: Vec<&'static str>,
    period_nanos: f32,
}

struct Queries {
    set: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    readable: wgpu::Buffer,
}

impl Timer {
    /// Creates a timer; `enabled` if the device has time-stamp queries.
    pub fn new(device: &Device, queue: &wgpu::Queue, enabled: bool) -> Self {
        let buffer = |usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("time stamps"),
                size: u64::from(SPANS) * 16,
                usage,
                mapped_at_creation: false,
            })
        };
        let queries = enabled.then(|| Queries {
            set: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("time stamps"),
                ty: wgpu::QueryType::Timestamp,
                count: SPANS * 2,
            }),
            resolved: buffer(wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC),
            readable: buffer(wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ),
        });
        let names = Vec::with_capacity(SPANS as usize);
        Self {
            queries,
            names,
            period_nanos: queue.get_timestamp_period(),
        }
    }

    /// Forgets the last frame.
    pub fn begin_frame(&mut self) {
        self.names.clear();
    }

    /// Time stamps for a render pass that is the `first` and/or `last` of span `name`.
    pub fn span(
        &mut self,
        name: &'static str,
        first: bool,
        last: bool,
    ) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        let queries = self.queries.as_ref()?;
        if first && self.names.len() < SPANS as usize {
            self.names.push(name);
        }
        if !(first || last) || self.names.last() != Some(&name) {
            return None;
        }
        let at = 2 * (self.names.len() as u32 - 1);
        Some(wgpu::RenderPassTimestampWrites {
            query_set: &queries.set,
            beginning_of_pass_write_index: first.then_some(at),
            end_of_pass_write_index: last.then_some(at + 1),
        })
    }

    /// The same for a compute pass.
    pub fn compute_span(
        &mut self,
        name: &'static str,
        first: bool,
        last: bool,
    ) -> Option<wgpu::ComputePassTimestampWrites<'_>> {
        let writes = self.span(name, first, last)?;
        Some(wgpu::ComputePassTimestampWrites {
            query_set: writes.query_set,
            beginning_of_pass_write_index: writes.beginning_of_pass_write_index,
            end_of_pass_write_index: writes.end_of_pass_write_index,
        })
    }

    /// Copies the time stamps into a buffer that can be read.
    pub fn end_frame(&self, encoder: &mut wgpu::CommandEncoder) {
        let Some(q) = &self.queries else { return };
        let count = 2 * self.names.len() as u32;
        if count > 0 {
            encoder.resolve_query_set(&q.set, 0..count, &q.resolved, 0);
            encoder.copy_buffer_to_buffer(&q.resolved, 0, &q.readable, 0, u64::from(count) * 8);
        }
    }

    /// Milliseconds of each span of the finished frame, in order; empty on devices without
    /// time-stamp queries. Waits for the device.
    pub fn read(&self, device: &Device) -> Vec<(&'static str, f64)> {
        let Some(q) = &self.queries else {
            return Vec::new();
        };
        q.readable.map_async(wgpu::MapMode::Read, .., |_| ());
        if device.poll(wgpu::PollType::wait_indefinitely()).is_err() {
            return Vec::new();
        }
        let spans = match q.readable.get_mapped_range(..) {
            Ok(bytes) => {
                let stamps: &[u64] = bytemuck::cast_slice(&bytes);
                self.names
                    .iter()
                    .zip(stamps.chunks_exact(2))
                    .map(|(name, s)| {
                        let ticks = s[1].saturating_sub(s[0]) as f64;
                        (*name, ticks * f64::from(self.period_nanos) * 1e-6)
                    })
                    .collect()
            }
            Err(_) => Vec::new(),
        };
        q.readable.unmap();
        spans
    }
}
