use super::*;
use crate::port::testing::PtyPair;
use std::os::fd::AsFd;
use std::time::Instant;

const SHORT: Duration = Duration::from_millis(50);

#[test]
fn bytes_before_a_hang_up_are_read_first() {
    // In this direction the kernel keeps the bytes, and reports POLLIN with POLLHUP.
    let PtyPair { device, driver, .. } = PtyPair::open();
    rustix::io::write(&driver, b"last words").unwrap();
    drop(driver);
    let mut buffer = [0; 4];
    let mut received = Vec::new();
    let error = loop {
        match read_from(device.as_fd(), &mut buffer, SHORT) {
            Ok(Some((count, _))) => received.extend_from_slice(&buffer[..count]),
            Ok(None) => panic!("neither bytes nor a hang-up"),
            Err(error) => break error,
        }
    };
    assert_eq!(received, b"last words");
    assert!(is_gone(&error), "{error}");
}

#[test]
fn silence_times_out_and_a_hang_up_ends_the_wait() {
    let PtyPair { device, driver, .. } = PtyPair::open();
    let began = Instant::now();
    assert!(
        read_from(driver.as_fd(), &mut [0; 4], SHORT)
            .unwrap()
            .is_none()
    );
    assert!(began.elapsed() >= SHORT);
    drop(device);
    let error = read_from(driver.as_fd(), &mut [0; 4], Duration::from_secs(60)).unwrap_err();
    assert!(is_gone(&error), "{error}");
    let error = write_all_to(driver.as_fd(), b"x", SHORT).unwrap_err();
    assert!(is_gone(&error), "{error}");
}

#[test]
fn a_prepared_port_keeps_its_rate_passes_every_byte_on_and_never_blocks() {
    use rustix::termios::{InputModes, tcgetattr};
    let pty = PtyPair::open();
    let builder =
        serialport::new(pty.path.to_string_lossy(), 123_456).parity(serialport::Parity::Odd);
    let mut port = builder.open_native().unwrap();
    prepare(&port).unwrap();
    // Otherwise a write could block beyond `timeout`.
    let flags = rustix::fs::fcntl_getfl(descriptor(&port)).unwrap();
    assert!(flags.contains(OFlags::NONBLOCK));
    let modes = tcgetattr(descriptor(&port)).unwrap().input_modes;
    assert_eq!(modes, InputModes::IGNBRK | InputModes::IGNPAR);
    assert_eq!(serialport::SerialPort::baud_rate(&port).unwrap(), 123_456);
    let every_byte: Vec<u8> = (0..=255).collect();
    rustix::io::write(&pty.device, &every_byte).unwrap();
    let mut received = Vec::new();
    while received.len() < every_byte.len() {
        let mut buffer = [0; 64];
        let (count, _) = read(&mut port, &mut buffer, SHORT).unwrap().unwrap();
        received.extend_from_slice(&buffer[..count]);
    }
    assert_eq!(received, every_byte);
    write_all(&mut port, &every_byte, SHORT).unwrap();
    let error = write_all(&mut port, &vec![0; 1 << 20], SHORT).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::TimedOut);
}

#[test]
fn locked_port_and_other_files_are_refused() {
    let pty = PtyPair::open();
    let path = &pty.path;
    assert!(!preflight(path).unwrap().is_gone());
    flock(&pty.driver, FlockOperation::NonBlockingLockExclusive).unwrap();
    let error = preflight(path).err().unwrap();
    assert_eq!(error.kind(), ErrorKind::ResourceBusy);
    assert!(is_pseudo_terminal(path) && !is_pseudo_terminal(Path::new("/dev/ttyS0")));
    assert!(preflight(Path::new("/dev/null")).is_err());
}
