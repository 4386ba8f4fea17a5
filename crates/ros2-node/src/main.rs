//! The calibration platform and the estimators as ROS 2 nodes, without a ROS installation.
//!
//! `ros2-node contact` estimates contacts from the messages of sensors and arms ([`live_ros`]); `ros2-node run` streams
//! the magnetometer and offers the service that runs the routine on the printer; `ros2-node play` publishes a recording
//! at its original pace. Topics, types and frames are those of recordings ([`bag::topics`]). With the feature
//! `foxglove`, all can publish to Foxglove, `contact` beside ROS 2 and the others instead.

mod both;
mod contact;
#[cfg(feature = "foxglove")]
mod feed;
#[cfg(feature = "foxglove")]
mod gate;
mod node;
mod outlet;
mod play;
mod request;
mod run;
#[cfg(feature = "foxglove")]
mod scene;
mod service;
#[cfg(feature = "foxglove")]
mod token;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Run the estimators or the calibration platform as a ROS 2 node
#[derive(Parser)]
#[command(name = "ros2-node", version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Contact(contact::Arguments),
    Run(run::Arguments),
    Play(play::Arguments),
}

fn main() -> ExitCode {
    let done = match Arguments::parse().command {
        Command::Contact(arguments) => contact::run(&arguments),
        Command::Run(arguments) => run::run(&arguments),
        Command::Play(arguments) => play::run(&arguments),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}
