//! A browser under test: the few commands of the [W3C WebDriver protocol] that the tests need, over
//! plain HTTP to a `chromedriver` on this machine. A command that fails panics with the driver's
//! answer, as an assertion would.
//!
//! [W3C WebDriver protocol]: https://www.w3.org/TR/webdriver2/

use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    time::Duration,
};

use serde_json::{Value, json};
use tempfile::TempDir;

/// Keys of the protocol's "normalised key values".
pub mod keys {
    /// End.
    pub const END: char = '\u{e010}';
    /// Home.
    pub const HOME: char = '\u{e011}';
    /// Arrow left.
    pub const LEFT: char = '\u{e012}';
    /// Arrow right.
    pub const RIGHT: char = '\u{e014}';
}

const ELEMENT: &str = "element-6066-11e4-a52e-4f735466cecf";
const PATIENCE: Duration = Duration::from_secs(60);
/// Quiet and offline: the page must not need, and the browser must not use, any network.
const BROWSER_FLAGS: [&str; 8] = [
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
];

/// How a browser is started.
#[derive(Clone, Copy, Debug)]
pub struct Window {
    /// Width and height, pixels.
    pub size_px: [u32; 2],
    /// Whether the browser asks pages for dark colours.
    pub dark: bool,
}

impl Default for Window {
    fn default() -> Self {
        Self { size_px: [1440, 900], dark: false }
    }
}

/// A running headless browser. Dropping it ends the browser and its driver, also while a test fails.
#[derive(Debug)]
pub struct Browser {
    driver: Driver,
    session: String,
}

/// An element of the page.
#[derive(Clone, Debug)]
pub struct Element(String);

impl Browser {
    /// Starts `chromedriver` on a free port and a browser with a profile of its own.
    ///
    /// # Panics
    /// If either cannot be started; the message says what to install.
    #[must_use]
    pub fn start(window: Window) -> Self {
        let driver = Driver::start();
        let [width, height] = window.size_px;
        let mut arguments: Vec<String> = BROWSER_FLAGS.iter().map(ToString::to_string).collect();
        arguments.push(format!("--user-data-dir={}", driver.profile.path().display()));
        arguments.push(format!("--window-size={width},{height}"));
        if window.dark {
            arguments.push("--force-dark-mode".into());
        }
        let capabilities = json!({"capabilities": {"alwaysMatch": {
            "browserName": "chrome",
            "goog:chromeOptions": {"args": arguments, "binary": program_path("chromium")},
            "goog:loggingPrefs": {"browser": "ALL"},
        }}});
        let answer = driver.call("POST", "/session", Some(&capabilities));
        let session = text_of(&answer["sessionId"]);
        Self { driver, session }
    }

    /// Opens a file of this machine.
    ///
    /// # Panics
    /// If there is no such file, or the browser does not load it.
    pub fn open(&self, path: &Path) {
        let path = fs::canonicalize(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        self.post("url", &json!({"url": format!("file://{}", path.display())}));
    }

    /// The title of the page.
    #[must_use]
    pub fn title(&self) -> String {
        text_of(&self.get("title"))
    }

    /// Runs a script's body in the page and returns what it returns.
    #[must_use]
    pub fn eval(&self, body: &str) -> Value {
        self.post("execute/sync", &json!({"script": body, "args": []}))
    }

    /// Everything the console got since the last call, as objects with `level` and `message`.
    #[must_use]
    pub fn console(&self) -> Vec<Value> {
        let entries = self.post("se/log", &json!({"type": "browser"}));
        entries.as_array().cloned().unwrap_or_default()
    }

    /// The first element that a CSS selector finds.
    ///
    /// # Panics
    /// If it finds none.
    #[must_use]
    pub fn find(&self, selector: &str) -> Element {
        let found = self.post("element", &json!({"using": "css selector", "value": selector}));
        Element(text_of(&found[ELEMENT]))
    }

    /// Types into an element as a person would, focusing it first.
    pub fn type_keys(&self, element: &Element, text: impl Into<String>) {
        self.post(&format!("element/{}/value", element.0), &json!({"text": text.into()}));
    }

    /// Clicks the middle of an element.
    pub fn click(&self, element: &Element) {
        self.drag(element, [0, 0], [0, 0]);
    }

    /// Presses the pointer at one offset from an element's middle, pixels, and lets go at another.
    pub fn drag(&self, element: &Element, from_px: [i32; 2], to_px: [i32; 2]) {
        let origin = json!({ELEMENT: element.0});
        let go = |[x, y]: [i32; 2]| json!({"type": "pointerMove", "duration": 50, "origin": origin, "x": x, "y": y});
        let steps = json!([
            go(from_px), {"type": "pointerDown", "button": 0}, go(to_px), {"type": "pointerUp", "button": 0}
        ]);
        self.pointer(&steps);
    }

    /// Moves the pointer to an offset from an element's middle, pixels.
    pub fn hover(&self, element: &Element, [x, y]: [i32; 2]) {
        let origin = json!({ELEMENT: element.0});
        self.pointer(&json!([{"type": "pointerMove", "duration": 50, "origin": origin, "x": x, "y": y}]));
    }

    fn pointer(&self, steps: &Value) {
        let actions = json!({"actions": [{
            "type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"}, "actions": steps
        }]});
        self.post("actions", &actions);
    }

    /// Turns the wheel over an element's middle; negative is away from the user.
    pub fn wheel(&self, element: &Element, delta_px: i32) {
        let actions = json!({"actions": [{"type": "wheel", "id": "wheel", "actions": [{
            "type": "scroll", "origin": {ELEMENT: element.0}, "x": 0, "y": 0,
            "deltaX": 0, "deltaY": delta_px, "duration": 0
        }]}]});
        self.post("actions", &actions);
    }

    /// Writes what the window shows as a PNG, and makes the folder for it.
    ///
    /// # Panics
    /// If the file cannot be written.
    pub fn screenshot(&self, path: &Path) {
        let png = decode_base64(&text_of(&self.get("screenshot")));
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
        }
        fs::write(path, png).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    }

    fn get(&self, command: &str) -> Value {
        self.driver.call("GET", &format!("/session/{}/{command}", self.session), None)
    }

    fn post(&self, command: &str, body: &Value) -> Value {
        self.driver.call("POST", &format!("/session/{}/{command}", self.session), Some(body))
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        // The driver closes the browser; whether it answers or not, `Driver` then ends the driver.
        let _ = self.driver.request("DELETE", &format!("/session/{}", self.session), None);
    }
}

/// A `chromedriver` process, killed when dropped.
#[derive(Debug)]
struct Driver {
    process: Child,
    port: u16,
    profile: TempDir,
}

impl Driver {
    fn start() -> Self {
        let profile = TempDir::with_prefix("skyroost-browser-").expect("a temporary folder can be made");
        let mut process = Command::new(program_path("chromedriver"))
            .arg("--port=0")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("chromedriver starts");
        let output = process.stdout.take().expect("chromedriver's output is piped");
        let mut driver = Self { process, port: 0, profile };
        driver.port = announced_port(output).expect("chromedriver says on which port it listens");
        driver
    }

    /// Sends a command and returns its value.
    fn call(&self, method: &str, path: &str, body: Option<&Value>) -> Value {
        let what = format!("{method} {path}");
        let (status, text) = self.request(method, path, body).unwrap_or_else(|e| panic!("{what}: {e}"));
        let answer: Value = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{what}: {e}: {text}"));
        assert_eq!(status, 200, "{what}: {}: {}", answer["value"]["error"], answer["value"]["message"]);
        answer["value"].clone()
    }

    /// One HTTP/1.1 exchange on a connection of its own; status and body.
    fn request(&self, method: &str, path: &str, body: Option<&Value>) -> std::io::Result<(u16, String)> {
        let body = body.map(ToString::to_string).unwrap_or_default();
        let port = self.port;
        let mut stream = TcpStream::connect(("127.0.0.1", port))?;
        stream.set_read_timeout(Some(PATIENCE))?;
        write!(
            stream,
            "{method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nConnection: close\r\n\
             Content-Type: application/json; charset=utf-8\r\nContent-Length: {}\r\n\r\n{body}",
            body.len()
        )?;
        read_response(BufReader::new(stream))
    }
}

impl Drop for Driver {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Reads the port off the line "ChromeDriver was started successfully on port N.".
fn announced_port(output: impl Read) -> Option<u16> {
    let lines = BufReader::new(output).lines().map_while(Result::ok);
    let port = |line: String| line.split_once("successfully on port ")?.1.trim_end_matches('.').parse().ok();
    lines.filter_map(port).next()
}

/// Status and body of a response whose length its header tells.
fn read_response(mut stream: impl BufRead) -> std::io::Result<(u16, String)> {
    let malformed = |line: &str| std::io::Error::new(std::io::ErrorKind::InvalidData, line.to_owned());
    let mut line = String::new();
    stream.read_line(&mut line)?;
    let status = line.split(' ').nth(1).and_then(|s| s.parse().ok()).ok_or_else(|| malformed(&line))?;
    let mut length = 0;
    loop {
        line.clear();
        stream.read_line(&mut line)?;
        let Some((name, value)) = line.split_once(':') else { break };
        if name.eq_ignore_ascii_case("content-length") {
            length = value.trim().parse().map_err(|_| malformed(&line))?;
        }
    }
    let mut body = vec![0; length];
    stream.read_exact(&mut body)?;
    String::from_utf8(body).map(|body| (status, body)).map_err(|_| malformed("a body that is not UTF-8"))
}

/// A program of the search path.
fn program_path(program: &str) -> PathBuf {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let found = std::env::split_paths(&path).map(|folder| folder.join(program)).find(|file| file.is_file());
    found.unwrap_or_else(|| {
        panic!(
            "{program} is not installed, and the report cannot be checked without a browser: run `cargo xtask \
             setup`, or install the packages chromium and chromium-driver"
        )
    })
}

fn text_of(value: &Value) -> String {
    value.as_str().unwrap_or_else(|| panic!("expected text, found {value}")).to_owned()
}

/// Base64 in the standard alphabet, as the driver sends it.
fn decode_base64(text: &str) -> Vec<u8> {
    let digit = |c: u8| match c {
        b'A'..=b'Z' => Some(c - b'A'),
        b'a'..=b'z' => Some(c - b'a' + 26),
        b'0'..=b'9' => Some(c - b'0' + 52),
        b'+' => Some(62),
        b'/' => Some(63),
        _ => None, // padding
    };
    let digits: Vec<u8> = text.bytes().filter_map(digit).collect();
    let mut bytes = Vec::with_capacity(digits.len() * 3 / 4);
    for group in digits.chunks(4) {
        let bits = group.iter().fold(0_u32, |bits, &d| (bits << 6) | u32::from(d)) << (6 * (4 - group.len()));
        bytes.extend(bits.to_be_bytes()[1..].iter().take(group.len() - 1));
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_of_rfc_4648_decodes() {
        for (text, bytes) in [("", ""), ("Zg==", "f"), ("Zm8=", "fo"), ("Zm9v", "foo"), ("Zm9vYmE=", "fooba")]
        {
            assert_eq!(decode_base64(text), bytes.as_bytes());
        }
    }

    #[test]
    fn a_response_is_read_to_its_length() {
        let text = "HTTP/1.1 404 Not Found\r\nContent-Type: x\r\ncontent-length: 2\r\n\r\n{}rest";
        assert_eq!(read_response(text.as_bytes()).unwrap(), (404, "{}".to_owned()));
        assert!(read_response("nonsense".as_bytes()).is_err());
    }
}
