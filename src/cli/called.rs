//! Commands that a program calls in place of a user, with the same arguments, checks and defaults. The Python package is made
//! of these calls: an option of a command is an argument of its call.

use super::{Cli, CliError, Command, StageSummary, Ui, parse, run};
use crate::progress::Progress;
use crate::run::AnyScene;
use clap::{Arg, ArgAction, CommandFactory};
use serde_json::{Map, Value, json};
use std::ffi::OsString;

/// Runs a command. `words` are those of a command line after the name of the program; nothing is printed, `caller` receives
/// what a user would see.
///
/// # Errors
/// [`CliError`], also if the words are no command.
pub fn call(
    words: impl IntoIterator<Item = OsString>,
    caller: &dyn Progress,
) -> Result<Vec<StageSummary>, CliError> {
    let (cli, given) = parse(with_program(words)).map_err(|e| usage_error(&e))?;
    let ui = Ui::new(&cli.common, given, Some(caller));
    run(&cli.command, &ui)?;
    Ok(ui.take_summaries())
}

/// Reads a scene. `words` are those of `satgs info`: the scene and how it is read.
///
/// # Errors
/// As [`call`].
pub fn read_scene(
    words: impl IntoIterator<Item = OsString>,
    caller: &dyn Progress,
) -> Result<AnyScene, CliError> {
    let words = std::iter::once("info".into()).chain(words);
    let (cli, given) = parse(with_program(words)).map_err(|e| usage_error(&e))?;
    let ui = Ui::new(&cli.common, given, Some(caller));
    match &cli.command {
        Command::Info(args) => args.read(&ui),
        _ => Err(CliError::input("these are not the words of `satgs info`", "name the scene first")),
    }
}

fn with_program(words: impl IntoIterator<Item = OsString>) -> impl Iterator<Item = OsString> {
    std::iter::once("satgs".into()).chain(words)
}

/// The error of words that are no command. What the command line adds for people who type is left out.
fn usage_error(error: &clap::Error) -> CliError {
    let text = error.render().to_string();
    let parts: Vec<&str> = text.split("\n\n").map(str::trim).collect();
    let message = parts.first().map_or("", |first| first.trim_start_matches("error: "));
    let message = message.lines().map(str::trim).collect::<Vec<_>>().join(" ");
    let tip = parts.iter().find_map(|part| part.strip_prefix("tip: "));
    CliError { hint: tip.map(str::to_owned), ..CliError::input(message, "") }
}

/// The arguments of all commands, by the names of the commands, without those that every command has: for each the long name
/// or the name of the position, whether it is a position, takes a value, is repeatable, is required, and its possible values.
#[must_use]
pub fn arguments() -> Value {
    let mut program = Cli::command();
    program.build();
    let mut out = Map::new();
    for command in program.get_subcommands() {
        describe(command, String::new(), &mut out);
    }
    out.into()
}

fn describe(command: &clap::Command, before: String, out: &mut Map<String, Value>) {
    if command.get_name() == "help" {
        return;
    }
    let name = before + command.get_name();
    for inner in command.get_subcommands() {
        describe(inner, format!("{name} "), out);
    }
    if command.has_subcommands() {
        return;
    }
    let own = command.get_arguments().filter(|a| a.get_help_heading() != Some(super::FOR_ALL));
    out.insert(name, own.map(argument).collect());
}

fn argument(argument: &Arg) -> Value {
    let id = argument.get_id().as_str();
    json!({
        "name": argument.get_long().unwrap_or(id),
        "is_position": argument.is_positional(),
        "takes_value": argument.get_action().takes_values(),
        "is_repeatable": matches!(argument.get_action(), ArgAction::Append),
        "is_required": argument.is_required_set(),
        "values": argument.get_possible_values().iter().map(|v| v.get_name()).collect::<Vec<_>>(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::ExitStatus;
    use crate::progress::Recorder;

    fn refused(words: &[&str]) -> CliError {
        let caller = Recorder::default();
        call(words.iter().map(OsString::from), &caller).expect_err("refused")
    }

    #[test]
    fn wrong_words_are_refused_in_one_sentence_without_usage() {
        let error = refused(&["ba", "scene", "-o", "run", "--gamma=9"]);
        assert_eq!(error.status, ExitStatus::WrongInput);
        assert_eq!(
            error.message,
            "invalid value '9' for '--gamma <GAMMA|auto>': expected a number from 1 to 4, or auto"
        );
        assert_eq!(error.hint, None);
        assert!(refused(&["ba", "scene", "--dem-sigma=5"]).message.contains("--dem <FILE>"));
        assert!(refused(&["nothing"]).message.contains("nothing"));
    }

    #[test]
    fn the_description_has_every_command_and_no_option_of_all() {
        let all = arguments();
        assert!(all["tile run"].is_array() && all["tile"].is_null() && all["help tile"].is_null());
        let names: Vec<&str> =
            all["train"].as_array().unwrap().iter().filter_map(|a| a["name"].as_str()).collect();
        assert!(names.contains(&"run") && names.contains(&"recipe") && !names.contains(&"json"), "{names:?}");
        let reference = |a: &&Value| a["name"] == "reference";
        let ba = all["ba"].as_array().unwrap().iter().find(reference).unwrap();
        assert_eq!((&ba["is_repeatable"], &ba["takes_value"]), (&Value::Bool(true), &Value::Bool(true)));
    }

    #[test]
    fn a_call_returns_the_summaries_and_prints_nothing() {
        let caller = Recorder::default();
        let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/data/town");
        let said = call(["info", scene].map(OsString::from), &caller).unwrap();
        assert_eq!(said.len(), 1);
        assert_eq!(said[0].stage, "info");
        assert_eq!(said[0].figures.as_ref().unwrap()["views"].as_array().unwrap().len(), 3);
    }
}
