//! Shows the picture in a window. Window systems require the main thread for the window; frames are
//! rendered on another thread and never wait for an event.

use super::OutputError;
use super::surface::{SurfaceScreen, WindowState};
use crate::Screen;
use penumbra_compositor::Gpu;
use penumbra_config::Monitor;
use penumbra_interface::threads;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use winit::application::ApplicationHandler;
use winit::dpi::{PhysicalPosition, PhysicalSize};
use winit::error::EventLoopError;
use winit::event::{ElementState, KeyEvent, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop, EventLoopProxy};
use winit::keyboard::{Key, NamedKey};
use winit::monitor::MonitorHandle;
use winit::window::{Fullscreen, Window, WindowAttributes, WindowId};

/// Options of the window.
#[derive(Clone, Debug)]
pub struct WindowOptions {
    /// Title.
    pub title: String,
    /// Monitor; the window system's choice if `None`.
    pub monitor: Option<Monitor>,
    /// Whether the window fills the monitor.
    pub fullscreen: bool,
    /// Size of the picture, pixels; a smaller monitor makes the window smaller.
    pub picture: (u32, u32),
    /// Adapter, as for [`Gpu::open`].
    pub adapter: Option<String>,
    /// Set when the user closes the window.
    pub shutdown: Arc<AtomicBool>,
}

type Job<R> = Box<dyn FnOnce(Gpu, Box<dyn Screen>) -> R + Send>;

/// Opens a window, runs `job` on another thread with a screen that presents in it, and
/// closes the window when `job` is done. Call it on the main thread. Escape and the
/// window's close button make the screen refuse the next picture; F fills the monitor.
///
/// # Errors
/// There is no window system, no such monitor, or no adapter that can render to the window.
pub fn run<R: Send + 'static>(
    options: WindowOptions,
    job: impl FnOnce(Gpu, Box<dyn Screen>) -> R + Send + 'static,
) -> Result<R, OutputError> {
    let events = event_loop()?;
    events.set_control_flow(ControlFlow::Wait);
    let mut app = App {
        options,
        job: Some(Box::new(job)),
        done: events.create_proxy(),
        window: None,
        state: Arc::default(),
        outcome: Outcome::Unopened,
    };
    events.run_app(&mut app).map_err(|e| unavailable(&e))?;
    app.outcome.into_result()
}

/// Connects to the window system. If one of its libraries is missing, winit panics; the panic is
/// caught and returned as an error.
fn event_loop() -> Result<EventLoop<Done>, OutputError> {
    let default_hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| ()));
    let made = catch_unwind(AssertUnwindSafe(|| EventLoop::with_user_event().build()));
    std::panic::set_hook(default_hook);
    match made {
        Ok(made) => made.map_err(|e| unavailable(&e)),
        Err(panic) => {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| panic.downcast_ref::<&str>().copied());
            Err(refused(
                text.unwrap_or("the window system cannot be reached"),
            ))
        }
    }
}

/// Removes the source location that winit puts before its messages.
fn unavailable(error: &EventLoopError) -> OutputError {
    let text = error.to_string();
    let last = text.rsplit(": ").next().unwrap_or(&text);
    refused(last.trim_end_matches('.'))
}

fn refused(reason: impl std::fmt::Display) -> OutputError {
    OutputError::Window {
        reason: reason.to_string(),
    }
}

/// Event: the frames' thread has ended.
#[derive(Debug)]
struct Done;

/// Sends [`Done`] when the thread ends, also by a panic.
struct SayDone(EventLoopProxy<Done>);

impl Drop for SayDone {
    fn drop(&mut self) {
        // Fails only if the event loop has ended.
        let _ = self.0.send_event(Done);
    }
}

/// State of the window.
enum Outcome<R> {
    /// The window system has not started yet.
    Unopened,
    /// The window could not be opened.
    Failed(OutputError),
    /// Frames are being rendered.
    Running(JoinHandle<R>),
}

impl<R> Outcome<R> {
    fn into_result(self) -> Result<R, OutputError> {
        match self {
            Self::Unopened => Err(refused("the window system ended before it started")),
            Self::Failed(error) => Err(error),
            Self::Running(thread) => thread
                .join()
                .map_err(|_| refused("the thread that renders frames stopped unexpectedly")),
        }
    }
}

struct App<R> {
    options: WindowOptions,
    job: Option<Job<R>>,
    done: EventLoopProxy<Done>,
    window: Option<Arc<Window>>,
    state: Arc<WindowState>,
    outcome: Outcome<R>,
}

impl<R: Send + 'static> ApplicationHandler<Done> for App<R> {
    fn resumed(&mut self, events: &ActiveEventLoop) {
        let Some(job) = self.job.take() else { return };
        match self.open(events, job) {
            Ok(thread) => self.outcome = Outcome::Running(thread),
            Err(error) => {
                self.outcome = Outcome::Failed(error);
                events.exit();
            }
        }
    }

    fn user_event(&mut self, events: &ActiveEventLoop, _: Done) {
        events.exit();
    }

    fn window_event(&mut self, _: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested => self.close(),
            WindowEvent::Resized(size) => self.state.set_size((size.width, size.height)),
            WindowEvent::KeyboardInput { event, .. } => self.key(&event),
            _ => (),
        }
    }
}

impl<R: Send + 'static> App<R> {
    fn open(
        &mut self,
        events: &ActiveEventLoop,
        job: Job<R>,
    ) -> Result<JoinHandle<R>, OutputError> {
        let monitor = chosen(self.options.monitor.as_ref(), events)?;
        let attributes = attributes(&self.options, monitor.or_else(|| events.primary_monitor()));
        let window = Arc::new(events.create_window(attributes).map_err(refused)?);
        window.set_cursor_visible(!self.options.fullscreen);
        let instance = Gpu::instance();
        let surface = instance
            .create_surface(window.clone())
            .map_err(|_| no_surface(self.options.adapter.as_deref()))?;
        let gpu = Gpu::open_for(instance, &surface, self.options.adapter.as_deref())?;
        let size = window.inner_size();
        self.state.set_size((size.width, size.height));
        let screen = SurfaceScreen::new(&gpu, surface, window.clone(), self.state.clone())?;
        self.window = Some(window);
        let done = self.done.clone();
        let frames = move || {
            let _done = SayDone(done);
            job(gpu, Box::new(screen))
        };
        threads::spawn("compositor", frames).map_err(refused)
    }

    /// Closes the window. The frames' thread ends with its next frame, without a wait here.
    fn close(&self) {
        self.state.close();
        self.options.shutdown.store(true, Ordering::Relaxed);
        if let Some(window) = &self.window {
            window.set_visible(false);
        }
    }

    fn key(&self, event: &KeyEvent) {
        if event.state != ElementState::Pressed || event.repeat {
            return;
        }
        match &event.logical_key {
            Key::Named(NamedKey::Escape) => self.close(),
            Key::Character(text) if text.eq_ignore_ascii_case("f") => self.toggle_fullscreen(),
            _ => (),
        }
    }

    fn toggle_fullscreen(&self) {
        let Some(window) = &self.window else { return };
        let fill = window.fullscreen().is_none();
        window.set_fullscreen(fill.then(|| Fullscreen::Borderless(window.current_monitor())));
        window.set_cursor_visible(!fill);
    }
}

/// The reason why the window cannot be rendered to: no driver, or none that supports windows.
fn no_surface(adapter: Option<&str>) -> OutputError {
    let drawn = Gpu::open(adapter);
    drawn.map_or_else(OutputError::from, |_| {
        refused("no graphics driver supports windows")
    })
}

/// Returns the requested monitor; `None` if none was requested.
fn chosen(
    requested: Option<&Monitor>,
    events: &ActiveEventLoop,
) -> Result<Option<MonitorHandle>, OutputError> {
    let Some(requested) = requested else {
        return Ok(None);
    };
    let monitors: Vec<_> = events.available_monitors().collect();
    let names: Vec<_> = monitors
        .iter()
        .map(|m| m.name().unwrap_or_default())
        .collect();
    let position = position(requested, &names).ok_or_else(|| {
        let list = names
            .iter()
            .enumerate()
            .map(|(i, name)| format!("{i} '{name}'"));
        let list = list.collect::<Vec<_>>().join(", ");
        refused(format!(
            "there is no monitor {}; available: {list}",
            option_text(requested)
        ))
    })?;
    Ok(monitors.into_iter().nth(position))
}

/// Formats a monitor as on the command line.
fn option_text(monitor: &Monitor) -> String {
    match monitor {
        Monitor::Index(index) => index.to_string(),
        Monitor::Name(name) => format!("'{name}'"),
    }
}

fn position(requested: &Monitor, names: &[String]) -> Option<usize> {
    match requested {
        Monitor::Index(index) => Some(*index as usize).filter(|i| *i < names.len()),
        Monitor::Name(part) => {
            let part = part.to_lowercase();
            names
                .iter()
                .position(|name| name.to_lowercase().contains(&part))
        }
    }
}

fn attributes(options: &WindowOptions, monitor: Option<MonitorHandle>) -> WindowAttributes {
    let mut attributes = Window::default_attributes().with_title(&options.title);
    let mut size = options.picture;
    if let Some(monitor) = &monitor {
        let (space, corner) = (monitor.size(), monitor.position());
        size = fitted(options.picture, (space.width, space.height));
        if options.monitor.is_some() {
            let middle = |corner: i32, space: u32, size: u32| {
                corner.saturating_add_unsigned(space.saturating_sub(size) / 2)
            };
            attributes = attributes.with_position(PhysicalPosition::new(
                middle(corner.x, space.width, size.0),
                middle(corner.y, space.height, size.1),
            ));
        }
    }
    attributes = attributes.with_inner_size(PhysicalSize::new(size.0, size.1));
    if options.fullscreen {
        attributes = attributes.with_fullscreen(Some(Fullscreen::Borderless(monitor)));
    }
    attributes
}

/// Returns the picture's size, or the largest size of equal aspect ratio that fits the monitor with a
/// margin.
fn fitted(picture: (u32, u32), monitor: (u32, u32)) -> (u32, u32) {
    let share = |room: u32, size: u32| 0.9 * f64::from(room) / f64::from(size.max(1));
    let scale = share(monitor.0, picture.0).min(share(monitor.1, picture.1));
    if !(0.01..1.0).contains(&scale) {
        return picture;
    }
    let scaled = |size: u32| (f64::from(size) * scale).round() as u32;
    (scaled(picture.0), scaled(picture.1))
}

#[cfg(test)]
mod tests {
    use super::{fitted, position};
    use penumbra_config::Monitor;

    #[test]
    fn window_fits_on_its_monitor() {
        assert_eq!(fitted((640, 480), (1920, 1080)), (640, 480));
        assert_eq!(fitted((1920, 1080), (1920, 1080)), (1728, 972));
        assert_eq!(fitted((640, 480), (0, 0)), (640, 480));
    }

    #[test]
    fn finds_monitors_by_number_or_part_of_the_name() {
        let names = ["eDP-1".to_owned(), "HDMI-A-1".to_owned()];
        assert_eq!(position(&Monitor::Index(1), &names), Some(1));
        assert_eq!(position(&Monitor::Index(2), &names), None);
        assert_eq!(position(&Monitor::Name("hdmi".to_owned()), &names), Some(1));
        assert_eq!(position(&Monitor::Name("DP-3".to_owned()), &names), None);
    }
}
