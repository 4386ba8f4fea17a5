//! Runs the benchmark in space: `bench FOLDER OUT`.

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let found = recorded::benchmark::run(arguments[1].as_ref(), arguments[2].as_ref(), &|name| eprintln!("{name}"))?;
    found.failures.iter().for_each(|failure| eprintln!("{failure}"));
    Ok(())
}
