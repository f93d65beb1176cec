use std::io::{IsTerminal, Write};

/// A text that redraws itself on a terminal, on standard error; elsewhere only the last one counts.
pub(super) struct Screen {
    on: bool,
    drawn: usize,
}

impl Screen {
    pub fn new(quiet: bool) -> Self {
        Self { on: !quiet && std::io::stderr().is_terminal(), drawn: 0 }
    }

    pub fn show(&mut self, text: &str) {
        if self.on {
            self.clear();
            self.drawn = text.lines().count();
            self.write(&format!("{text}\n"));
        }
    }

    /// Makes room for the last text, which goes to standard output.
    pub fn end(&mut self) {
        if self.on {
            self.clear();
        }
    }

    fn clear(&mut self) {
        if self.drawn > 0 {
            // up so many lines, then clear to the end
            self.write(&format!("\x1b[{}A\x1b[J", self.drawn));
            self.drawn = 0;
        }
    }

    /// A terminal that has gone away has seen enough.
    fn write(&self, text: &str) {
        let mut out = std::io::stderr().lock();
        let _ = out.write_all(text.as_bytes()).and_then(|()| out.flush());
    }
}
