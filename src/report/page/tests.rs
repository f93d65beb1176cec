use super::*;
use crate::report::{Colour, Panel};

fn everything() -> Page {
    let mut table =
        Table::new([Column::text("α"), Column::text("note")].into_iter().chain(Column::compared("Vol, N⁶")));
    table.push_group([Cell::text("1"), "<script>".into()].into_iter().chain(Cell::compared(0.7596, Some(0.76))));
    table.push(
        [Cell::text("2").tone(Tone::Bad).hint("a \"hint\""), "".into()].into_iter().chain(Cell::compared(14.1, None)),
    );
    table.push([Cell::percent(Some(0.5)).bar(0.5)]);
    let figure = Figure::new("Line").panel(Panel::new("v", "m/s").line("x", Colour::Blue, [[0.0, 0.0], [1.0, 1.0]]));
    let folded = Section::new("More").paragraph("inside").details(Section::new("Deeper").code("a\n  b & c"));
    let section =
        Section::new("Results").paragraph("what <b>came</b> out").list(["one", "two"]).table(table.caption("Volumes"));
    Page::new("A & B").lead("About it").fact("steps", "12").section(section.figure(figure, "the line").details(folded))
}

#[test]
fn a_page_is_whole_and_everything_in_it_is_escaped() {
    let page = everything().html().unwrap();
    for text in [
        "<title>A &amp; B</title>",
        "what &lt;b&gt;came&lt;",
        "&lt;script&gt;",
        "a &quot;hint&quot;",
        "<svg xmlns",
        "the line</figcaption>",
        "<summary>Deeper</summary>",
        "b &amp; c</pre>",
        "<dd>12</dd>",
        "0.7596",
        "-0.05 %",
        "<caption>Volumes",
        "--share:50%",
    ] {
        assert!(page.contains(text), "{text} in\n{page}");
    }
    assert!(page.ends_with("</html>") && !page.contains("<script>") && !page.contains("<b>"));
    // nothing is fetched
    assert!(!page.replace("http://www.w3.org/2000/svg", "").contains("http"));
    for tag in ["table", "details", "section", "figure", "div", "tr", "td"] {
        let opened = page.matches(&format!("<{tag}>")).count() + page.matches(&format!("<{tag} ")).count();
        assert_eq!(opened, page.matches(&format!("</{tag}>")).count(), "{tag}");
    }
    if let Ok(folder) = std::env::var("MAVOBSERVER_PICTURES") {
        std::fs::write(format!("{folder}/page.html"), page).unwrap();
    }
}

#[test]
fn numbers_keep_four_digits() {
    let written = |v: f64| Cell::number(v).to_string();
    assert_eq!(
        [written(0.0), written(12.3456), written(-0.00123456), written(123456.7)],
        ["0", "12.35", "-0.001235", "123457"]
    );
    assert_eq!([written(2.5e-6), written(f64::INFINITY)], ["2.500e-6", "–"]);
}
