//! Passes warnings and errors of the log on standard error to the log of the status page.

use penumbra_status::SharedStatus;
use penumbra_status::log::Level as PageLevel;
use std::fmt::{Debug, Write};
use std::sync::{Arc, OnceLock};
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::Layer;
use tracing_subscriber::layer::Context;

static PAGE: OnceLock<Arc<SharedStatus>> = OnceLock::new();

/// Sends warnings and errors to the page of `status` from now on. Only the first call has an effect.
pub fn set_page(status: &Arc<SharedStatus>) {
    let _ = PAGE.set(Arc::clone(status));
}

/// The layer of the log; it sees what is written to standard error.
pub struct PageLog;

impl<S: Subscriber> Layer<S> for PageLog {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let level = match *event.metadata().level() {
            Level::ERROR => PageLevel::Error,
            Level::WARN => PageLevel::Warning,
            _ => return,
        };
        let Some(page) = PAGE.get() else { return };
        let mut text = Text::default();
        event.record(&mut text);
        page.forward(level, &text.finish());
    }
}

/// The message of an event and its other fields.
#[derive(Default)]
struct Text {
    message: String,
    fields: String,
}

impl Text {
    fn finish(self) -> String {
        match (self.message.is_empty(), self.fields.is_empty()) {
            (_, true) => self.message,
            (true, false) => self.fields,
            (false, false) => format!("{} ({})", self.message, self.fields),
        }
    }
}

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        let (name, fields) = (field.name(), &mut self.fields);
        match name {
            "message" => self.message = format!("{value:?}"),
            // The status names the device.
            "device" => (),
            _ => {
                let separator = if fields.is_empty() { "" } else { ", " };
                let _ = write!(fields, "{separator}{name} {value:?}");
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use penumbra_status::Settings;
    use tracing_subscriber::layer::SubscriberExt;

    #[test]
    fn warnings_reach_the_page_and_other_events_do_not() {
        let status = SharedStatus::new(Settings::default());
        set_page(&status);
        let log = tracing_subscriber::registry().with(PageLog);
        tracing::subscriber::with_default(log, || {
            tracing::info!("nothing to see");
            tracing::warn!(node = "lid", "weights are ignored");
            tracing::error!(device = "scene camera", "the driver has panicked");
        });
        let entries = status.log_since(0);
        let entries: Vec<_> = entries.iter().map(|e| (e.level, &*e.text)).collect();
        let expected = [
            (PageLevel::Warning, "weights are ignored (node \"lid\")"),
            (PageLevel::Error, "the driver has panicked"),
        ];
        assert_eq!(entries, expected);
    }
}
