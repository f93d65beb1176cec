//! Generates from the dialects what `src/wire` includes: the types of `dialects/mavobserver.xml` into
//! `OUT_DIR/mavobserver.rs`, and the definitions of all messages as tables into `OUT_DIR/definitions.rs`.

#[path = "dialects/xml.rs"]
mod xml;

use std::error::Error;
use std::fs::{self, File};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

const DIALECTS: &str = "dialects";

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed={DIALECTS}");
    // The generated types carry attributes for features that this crate does not have.
    println!("cargo:rustc-check-cfg=cfg(feature, values(\"arbitrary\", \"serde\", \"ts-rs\"))");
    let out = PathBuf::from(std::env::var_os("OUT_DIR").ok_or("OUT_DIR is not set")?);
    let generated = out.join("mavobserver.rs");
    mavlink_bindgen::parser::generate(
        Path::new(DIALECTS),
        Path::new("mavobserver.xml"),
        &mut BufWriter::new(File::create(generated)?),
    )?;
    // The generated file begins with inner attributes, so it must be a module of its own and cannot be included as is.
    fs::write(out.join("mod.rs"), "pub mod mavobserver;\n")?;

    let mut definitions = xml::Definitions::default();
    for (directory, file) in [("mavlink", "ardupilotmega.xml"), ("mavlink", "development.xml"), ("", "mavobserver.xml")]
    {
        definitions.read(&Path::new(DIALECTS).join(directory), file)?;
    }
    fs::write(out.join("definitions.rs"), definitions.source()?)?;
    Ok(())
}
