//! The window, on an X server without a monitor (Xvfb).

use crate::program::{Desk, text};
use crate::sessions::scene_frames;
use penumbra_picture::{Picture, YuvEncoding};
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// An X server that stores its screen in a file.
struct Server {
    child: Child,
    display: String,
}

impl Server {
    /// Starts the server; `None` without Xvfb.
    fn start(desk: &Desk) -> Option<Self> {
        let options = [
            "-displayfd",
            "1",
            "-screen",
            "0",
            "800x600x24",
            "-nolisten",
            "tcp",
            "-fbdir",
        ];
        let mut child = Command::new("Xvfb")
            .args(options)
            .arg(desk.path(""))
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .ok()?;
        let mut number = String::new();
        BufReader::new(child.stdout.as_mut()?)
            .read_line(&mut number)
            .ok()?;
        let display = format!(":{}", number.trim());
        Some(Self { child, display })
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
    }
}

/// Reads the rows of the screen as RGB; the file has the format XWD.
fn screen(desk: &Desk) -> Vec<Vec<[u8; 3]>> {
    let file = desk.read("Xvfb_screen0");
    let word = |i: usize| u32::from_be_bytes(file[4 * i..4 * i + 4].try_into().unwrap()) as usize;
    let (header, width, height, stride, colours) = (word(0), word(4), word(5), word(12), word(19));
    let pixels = &file[header + 12 * colours..];
    let row = |row: &[u8]| {
        row.chunks_exact(4)
            .take(width)
            .map(|p| [p[2], p[1], p[0]])
            .collect()
    };
    pixels.chunks_exact(stride).take(height).map(row).collect()
}

/// Searches the screen for `picture`; returns its left and top.
fn find(screen: &[Vec<[u8; 3]>], picture: &Picture) -> Option<(usize, usize)> {
    let (width, height) = (picture.width as usize, picture.height as usize);
    let pixel = |x: usize, y: usize| picture.rgb(x as u32, y as u32);
    let here = |left: usize, top: usize| {
        (0..height).all(|y| (0..width).all(|x| screen[top + y][left + x] == pixel(x, y)))
    };
    let places = (0..=screen.len() - height)
        .flat_map(|top| (0..=screen[0].len() - width).map(move |left| (left, top)));
    places.into_iter().find(|(left, top)| here(*left, *top))
}

#[test]
fn window_shows_the_picture() {
    let desk = Desk::new();
    let Some(server) = Server::start(&desk) else {
        eprintln!("SKIPPED window_shows_the_picture: Xvfb is missing (apt-get install xvfb)");
        return;
    };
    let session = crate::program::desk_session().display().to_string();
    // Slow, so that the first picture stays on the screen.
    let line = "--scene none --light-count 8 --speed 0.01 --loop --listen 127.0.0.1:0";
    let arguments: Vec<_> = ["replay", &session]
        .into_iter()
        .chain(line.split(' '))
        .collect();
    let mut command = desk.command(&arguments);
    command
        .env("DISPLAY", &server.display)
        .stderr(Stdio::piped())
        .stdout(Stdio::null());
    let child = command.spawn().unwrap();
    let first = Picture::decode(&scene_frames(1)[0], &YuvEncoding::default()).unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    let position = loop {
        let position = find(&screen(&desk), &first);
        if position.is_some() || Instant::now() > deadline {
            break position;
        }
        std::thread::sleep(Duration::from_millis(200));
    };
    let id = child.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-TERM", &id])
            .status()
            .unwrap()
            .success()
    );
    let output = child.wait_with_output().unwrap();
    assert!(
        position.is_some(),
        "the picture is not on the screen; {}",
        text(&output.stderr)
    );
    assert!(output.status.success(), "{}", text(&output.stderr));
}
