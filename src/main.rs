//! The command line.

use penumbra::bench::{BenchOptions, run};

fn main() -> anyhow::Result<()> {
    let gpu = penumbra::compositor::Gpu::open(None)?;
    println!("{}", penumbra::bench::Row::HEADING);
    run(
        &gpu,
        &BenchOptions {
            frames: Some(20),
            ..Default::default()
        },
        &mut |row| println!("{row}"),
    )?;
    Ok(())
}
