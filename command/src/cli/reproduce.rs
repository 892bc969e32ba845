//! `mrvis reproduce --out DIR`: the figures and tables of the paper, made again.

use super::args::{Common, command_line};
use super::inputs::{Inputs, Output, check_folder};
use super::progress::Bar;
use crate::reproduce::{Context, Item, chosen, page, run as make};
use mrvis::Result;
use mrvis::internals::files::{WholeFile, write_json};
use std::fmt::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Make the figures and tables of the paper again, with verdicts computed from numbers: paper.html. Exit code 1 if a verdict
/// fails.
#[derive(clap::Args, Debug)]
#[command(mut_arg("seed", |a| a.hide(true)))]
#[command(mut_arg("unit", |a| a.hide(true)))]
pub struct Args {
    /// Folder for paper.html and reproduce.json (created if missing).
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Only this item, such as fig9; repeatable [default: all].
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    #[command(flatten)]
    pub common: Common,
}

/// Names of the files.
const PAGE: &str = "paper.html";
const RECORD: &str = "reproduce.json";

pub fn run(args: &Args) -> Result<ExitCode> {
    let (entries, common) = (chosen(&args.only)?, &args.common);
    let _folder = check_folder(&args.out)?;
    common.check_json()?;
    let files = [PAGE, RECORD].map(String::from);
    common.check_outputs(&Inputs::default(), Output::within("--out", &args.out, files))?;
    let bar = Bar::new(common.quiet);
    let context = Context::new(false, &bar);
    let report = common.on_threads(|| make(&entries, &context))?;
    bar.finish();
    let path = args.out.join(PAGE);
    WholeFile::write(&path, page(&report, &command_line())?)?;
    write_json(&args.out.join(RECORD), &report)?;
    common.write_json(&report)?;
    let mut text = String::new();
    for item in &report.items {
        line(&mut text, item);
    }
    let (hold, all) = (report.hold, report.items.len());
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{}; {:.0} s", report.summary(), report.seconds);
    let _ = writeln!(text, "page: {}", path.display());
    common.print(&text)?;
    Ok(ExitCode::from(u8::from(hold < all)))
}

/// The verdict of an item, with the reason of a failure.
fn line(text: &mut String, item: &Item) {
    let _ = writeln!(text, "{:13}  {:5.1} s  {}", item.verdict(), item.seconds, item.title);
    for check in item.checks.iter().filter(|check| !check.holds) {
        let _ = writeln!(text, "         {}", check.failure());
    }
}
