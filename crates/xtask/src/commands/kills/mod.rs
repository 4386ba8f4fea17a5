//! `cargo xtask kills`: commands that are killed at random moments or run out of disk space, and are then repeated. No
//! file may be lost, and the final files must be those of an undisturbed command.

mod cases;
mod disturbance;
mod files;
mod signal;

use std::fs;
use std::path::PathBuf;
use std::time::Instant;

use crate::failure::{Failure, Outcome};
use crate::parts::step;
use crate::pipeline;
use crate::repository::root;
use cases::{CASES, Case, Workspace};
use disturbance::{DISTURBANCES, Disturbance, Random};

/// Folder of all files.
const FOLDER: &str = "target/kills";
/// Workspace of the disturbed command in that folder.
const DISTURBED: &str = "disturbed";
/// Default number of kills.
const COUNT: u64 = 100;
/// Latest moment of a kill, as a fraction of the duration of the undisturbed command.
const LATEST: f64 = 0.95;

pub(crate) fn run(arguments: &[String]) -> Outcome {
    let (count, seed) = options(arguments)?;
    pipeline::prepare()?;
    disturb(count, seed)
}

/// Disturbs commands, `count` times in all, at moments drawn from the seed.
///
/// # Errors
/// If a file was lost, or a repeated command failed or wrote other files.
pub(crate) fn disturb(count: u64, seed: u64) -> Outcome {
    let folder = root().join(FOLDER);
    Workspace::release(&folder.join(DISTURBED));
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(|error| Failure::new(format!("{}: {error}", folder.display())))?;
    }
    let mut prepared = Vec::new();
    step("the undisturbed commands", || {
        let mut state = Workspace::create(folder.join("whole"))?;
        for case in CASES {
            let before = state.copy_to(folder.join("before").join(case.name))?;
            let begun = Instant::now();
            state.run(case)?;
            let duration = begun.elapsed();
            eprintln!("{:14} {:.2} s", case.name, duration.as_secs_f64());
            let after = state.copy_to(folder.join("after").join(case.name))?;
            prepared.push(Prepared { case, before, after, duration });
        }
        Ok(())
    })?;
    let mut random = Random::new(seed);
    let mut table = Table::default();
    step(&format!("{count} disturbances"), || {
        for number in 0..count {
            // Every case meets every disturbance in turn.
            let (cases, kinds) = (prepared.len() as u64, DISTURBANCES.len() as u64);
            let prepared = &prepared[(number % cases) as usize];
            let disturbance = DISTURBANCES[((number / cases + number % cases) % kinds) as usize];
            let share = LATEST * random.share();
            let outcome = prepared.disturb(disturbance, share, folder.join(DISTURBED));
            let (name, kind) = (prepared.case.name, disturbance.name());
            eprintln!("{number:4} {name:14} {kind:10} at {:5.1} %  {}", 100.0 * share, described(&outcome));
            table.add(name, kind, &outcome);
        }
        Ok(())
    })?;
    println!("\n{}", table.text());
    table.verdict()
}

fn options(arguments: &[String]) -> Result<(u64, u64), Failure> {
    let (mut count, mut seed) = (COUNT, 1);
    let mut rest = arguments.iter().map(String::as_str);
    while let Some(option) = rest.next() {
        let target = match option {
            "--count" => &mut count,
            "--seed" => &mut seed,
            _ => return Err(Failure::new(format!("kills: found `{option}`, expected [--count N] [--seed S]"))),
        };
        let value = rest.next().unwrap_or("nothing");
        *target =
            value.parse().map_err(|_| Failure::new(format!("kills: {option}: found `{value}`, expected a number")))?;
    }
    Ok((count, seed))
}

/// A command with the files before and after it.
struct Prepared {
    case: &'static Case,
    before: Workspace,
    after: Workspace,
    duration: std::time::Duration,
}

/// Result of a disturbed command and its repetition: whether the disturbance came before its end, or what is wrong.
type Disturbed = Result<bool, Failure>;

impl Prepared {
    fn disturb(&self, disturbance: Disturbance, share: f64, folder: PathBuf) -> Disturbed {
        let mut state = self.before.copy_to(folder)?;
        let moment = self.duration.mul_f64(share);
        let was_in_time = disturbance.apply(&mut state, self.case, moment, share, &self.before, &self.after)?;
        state.check_nothing_is_lost(self.case, &self.before, &self.after)?;
        (self.case.again)(&mut state, self.case, &self.after)?;
        state.remove()?;
        Ok(was_in_time)
    }
}

fn described(outcome: &Disturbed) -> String {
    match outcome {
        Ok(true) => "complete after the repetition".into(),
        Ok(false) => "complete; the command had ended before".into(),
        Err(failure) => format!("WRONG: {failure}"),
    }
}

/// Numbers of disturbances by command and kind.
#[derive(Default)]
struct Table(Vec<Row>);

struct Row {
    case: &'static str,
    kind: &'static str,
    disturbed: u64,
    ended: u64,
    wrong: u64,
}

impl Table {
    fn add(&mut self, case: &'static str, kind: &'static str, outcome: &Disturbed) {
        let place = self.0.iter().position(|row| row.case == case && row.kind == kind).unwrap_or(self.0.len());
        if place == self.0.len() {
            self.0.push(Row { case, kind, disturbed: 0, ended: 0, wrong: 0 });
        }
        let row = &mut self.0[place];
        match outcome {
            Ok(true) => row.disturbed += 1,
            Ok(false) => row.ended += 1,
            Err(_) => row.wrong += 1,
        }
    }

    fn text(&self) -> String {
        let mut text =
            format!("{:14} {:10} {:>9} {:>13} {:>5}\n", "command", "by", "disturbed", "ended before", "wrong");
        for Row { case, kind, disturbed, ended, wrong } in &self.0 {
            text += &format!("{case:14} {kind:10} {disturbed:9} {ended:13} {wrong:5}\n");
        }
        let sum = |number: fn(&Row) -> u64| self.0.iter().map(number).sum::<u64>();
        let (disturbed, ended, wrong) = (sum(|row| row.disturbed), sum(|row| row.ended), sum(|row| row.wrong));
        text + &format!("{:25} {disturbed:9} {ended:13} {wrong:5}\n", "all")
    }

    fn verdict(&self) -> Outcome {
        match self.0.iter().map(|row| row.wrong).sum::<u64>() {
            0 => Ok(()),
            wrong => Err(Failure::new(format!("{wrong} disturbed commands lost or changed files"))),
        }
    }
}
