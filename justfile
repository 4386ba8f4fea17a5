# Recipes, each one cargo command. Without just installed: ./just <recipe>

set positional-arguments

whisker := "cargo run --release --package whisker-cli --bin whisker --"

# List the recipes
_default:
    @{{ quote(just_executable()) }} --justfile {{ quote(justfile()) }} --list --unsorted

# Simulate, fit, evaluate and report the standard suite: results/standard/index.html
demo *arguments:
    @cargo xtask demo "$@"

# Run every test: Rust, Python, end to end
test:
    @cargo xtask test

# Simulate a suite or scenes with MuJoCo: just simulate scenes/suites/standard.json --out datasets/standard
simulate *arguments: setup
    @{{ whisker }} simulate "$@"

# Fit the sensor models of a suite's calibration traces: just fit scenes/suites/standard.json
fit *arguments:
    @{{ whisker }} fit "$@"

# Replay one trace through one estimator: just replay --help
replay *arguments:
    @{{ whisker }} replay "$@"

# Evaluate every estimator on a suite or on folders of traces: just evaluate scenes/suites/standard.json
evaluate *arguments:
    @{{ whisker }} evaluate "$@"

# Draw figures and page of a run: just report results/standard
report *arguments:
    @{{ whisker }} report "$@"

# Run the benchmarks
bench:
    @cargo xtask bench

# Measure time and memory of batches and long traces
batch:
    @cargo xtask batch

# Test the calibration platform on its emulated rig: just rig [--soak SECONDS]
rig *arguments:
    @cargo xtask rig "$@"

# Measure latency, losses and memory of live estimation with six whiskers: just live [--space] [--seconds N]
live *arguments:
    @cargo xtask live "$@"

# Measure the Python package: installation, size, and times compared with those in Rust
package:
    @cargo xtask package

# Time the filters against other libraries: results/reference/peers.csv
peers:
    @cargo xtask peers

# Fuzz every parser: just fuzz [TARGET] [--seconds N]
fuzz *arguments:
    @cargo xtask fuzz "$@"

# Build the reference of the Rust crates and of the Python package: target/doc/
reference:
    @cargo xtask reference

# Check licences, sources and known vulnerabilities of the dependencies
deny:
    @cargo xtask deny

# Simulate the golden traces of the tests: datasets/golden/
golden:
    @cargo xtask golden

# Measure every claim of the documentation: results/reference/claims.csv
reproduce *arguments:
    @cargo xtask reproduce "$@"

# Measure the reliability of the stated covariances on random scenes, with inexact calibrations and with friction: certainty/, contacts/, quantities/ and yielding/ in results/reference/
random *arguments:
    @cargo xtask random "$@"

# Compare the simulator with beam theory, claim by claim: results/physics/
physics:
    @cargo xtask physics

# Kill commands at random moments or fill their disk, repeat them, and compare their files: just kills [--count N] [--seed S]
kills *arguments:
    @cargo xtask kills "$@"

# Evaluate recordings of real sensors: just real --recordings FOLDER
real *arguments:
    @cargo xtask real "$@"

# Write the measured values of the documentation from results/reference/
docs:
    @cargo xtask docs

# Check format, lints and documentation of Rust and Python
check:
    @cargo xtask check

# Run check and test
ci:
    @cargo xtask ci

# Install the Python packages in .venv
setup:
    @cargo xtask setup
