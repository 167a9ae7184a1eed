//! The grammar of expressions: text to syntax tree, with errors that point.
//!
//! ```text
//! expression = sum [ ("<" | "<=" | ">" | ">=" | "==" | "!=") sum ]
//! sum        = term { ("+" | "-") term }
//! term       = factor { ("*" | "/") factor }
//! factor     = ("-" | "+") factor | power
//! power      = atom [ "^" factor ]                     right associative, binds tighter than the sign before it
//! atom       = number | name | name "(" list ")" | "(" expression ")"
//! ```
//! A model file is data: nothing here can call anything but the functions listed in [`FUNCTIONS`].

use super::graph::{Fun1, Fun2};
use crate::error::{Error, Result, nearest};

/// Syntax tree; `usize` is the byte offset in the source, for messages.
#[derive(Clone, Debug, PartialEq)]
pub enum Ast {
    /// A literal.
    Number(f64),
    /// A name to be resolved by the model.
    Name(String, usize),
    /// A function of one argument.
    One(Fun1, Box<Ast>, usize),
    /// A function of two arguments.
    Two(Fun2, Box<Ast>, Box<Ast>, usize),
    /// `if(condition, then, otherwise)`.
    If(Box<[Ast; 3]>, usize),
}

impl Ast {
    /// Whether a name occurs.
    pub fn mentions(&self, word: &str) -> bool {
        match self {
            Self::Number(_) => false,
            Self::Name(name, _) => name == word,
            Self::One(_, a, _) => a.mentions(word),
            Self::Two(_, a, b, _) => a.mentions(word) || b.mentions(word),
            Self::If(three, _) => three.iter().any(|a| a.mentions(word)),
        }
    }
}

const ONE: [(&str, Fun1); 14] = [
    ("sin", Fun1::Sin),
    ("cos", Fun1::Cos),
    ("tan", Fun1::Tan),
    ("asin", Fun1::Asin),
    ("acos", Fun1::Acos),
    ("atan", Fun1::Atan),
    ("sinh", Fun1::Sinh),
    ("cosh", Fun1::Cosh),
    ("tanh", Fun1::Tanh),
    ("exp", Fun1::Exp),
    ("log", Fun1::Log),
    ("sqrt", Fun1::Sqrt),
    ("abs", Fun1::Abs),
    ("sign", Fun1::Sign),
];
const TWO: [(&str, Fun2); 3] = [("atan2", Fun2::Atan2), ("min", Fun2::Min), ("max", Fun2::Max)];

/// Every function an expression may call.
pub const FUNCTIONS: [&str; 18] = [
    "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "sqrt", "abs", "sign", "atan2",
    "min", "max", "if",
];

/// Names that a model may not give to its own quantities.
pub fn is_reserved(name: &str) -> bool {
    name == "t" || name == "pi" || FUNCTIONS.contains(&name)
}

/// Whether a text is a name: a letter or underscore, then letters, digits or underscores.
pub fn is_name(text: &str) -> bool {
    let mut chars = text.chars();
    chars.next().is_some_and(|c| c.is_alphabetic() || c == '_') && chars.all(|c| c.is_alphanumeric() || c == '_')
}

/// An [`Error::Expression`] at a byte offset of `source`.
pub fn error_at(path: &str, source: &str, offset: usize, message: String) -> Error {
    let offset = offset.min(source.len());
    let before = &source[..offset];
    let line = before.matches('\n').count() + 1;
    let start = before.rfind('\n').map_or(0, |i| i + 1);
    let column = source[start..offset].chars().count() + 1;
    let source_line = source[start..].lines().next().unwrap_or("").to_string();
    Error::Expression { path: path.to_string(), line, column, message, source_line }
}

/// Deepest nesting of brackets, signs and powers; a deeper text is refused rather than overflow the stack.
const DEPTH: usize = 200;

/// Most operators in one expression: a longer chain is refused rather than overflow the stack of what walks the tree.
const LENGTH: usize = 2000;

/// Parses one expression. `path` says where it stands in the document, for messages.
///
/// # Errors
/// [`Error::Expression`] with line, column and the line itself.
pub fn parse(source: &str, path: &str) -> Result<Ast> {
    let mut p = Parser { source, path, at: 0, depth: 0, operators: 0 };
    let tree = p.expression()?;
    p.space();
    if p.at < source.len() {
        let rest: String = source[p.at..].chars().take(12).collect();
        return Err(p.error(p.at, format!("expected an operator or the end, found `{rest}`")));
    }
    Ok(tree)
}

struct Parser<'a> {
    source: &'a str,
    path: &'a str,
    at: usize,
    depth: usize,
    operators: usize,
}

impl Parser<'_> {
    fn error(&self, offset: usize, message: String) -> Error {
        error_at(self.path, self.source, offset, message)
    }

    fn space(&mut self) {
        let rest = &self.source[self.at..];
        self.at += rest.len() - rest.trim_start().len();
    }

    fn eat(&mut self, token: &str) -> bool {
        self.space();
        let hit = self.source[self.at..].starts_with(token);
        if hit {
            self.at += token.len();
        }
        hit
    }

    fn expression(&mut self) -> Result<Ast> {
        let left = self.sum()?;
        self.space();
        let at = self.at;
        let order =
            [("<=", Fun2::Le), (">=", Fun2::Ge), ("==", Fun2::Eq), ("!=", Fun2::Ne), ("<", Fun2::Lt), (">", Fun2::Gt)];
        for (token, f) in order {
            if self.eat(token) {
                let right = self.sum()?;
                return Ok(Ast::Two(f, Box::new(left), Box::new(right), at));
            }
        }
        if self.source[self.at..].starts_with('=') {
            return Err(self.error(at, "a single `=` is not an operator; write `==` to compare".into()));
        }
        Ok(left)
    }

    fn chain(&mut self, ops: [(&str, Fun2); 2], next: fn(&mut Self) -> Result<Ast>) -> Result<Ast> {
        let mut left = next(self)?;
        loop {
            self.space();
            let at = self.at;
            let Some(&(token, f)) = ops.iter().find(|(t, _)| self.source[self.at..].starts_with(t)) else {
                return Ok(left);
            };
            if self.source[self.at..].starts_with("**") {
                return Err(self.error(at, "`**` is not an operator; write `^` for powers".into()));
            }
            self.operators += 1;
            if self.operators > LENGTH {
                return Err(
                    self.error(at, format!("more than {LENGTH} operators; split the expression with [signals]"))
                );
            }
            self.at += token.len();
            let right = next(self)?;
            left = Ast::Two(f, Box::new(left), Box::new(right), at);
        }
    }

    fn sum(&mut self) -> Result<Ast> {
        self.chain([("+", Fun2::Add), ("-", Fun2::Sub)], Self::term)
    }

    fn term(&mut self) -> Result<Ast> {
        self.chain([("*", Fun2::Mul), ("/", Fun2::Div)], Self::factor)
    }

    fn factor(&mut self) -> Result<Ast> {
        self.depth += 1;
        if self.depth > DEPTH {
            return Err(self.error(self.at, format!("nested deeper than {DEPTH}; split it with [signals]")));
        }
        self.space();
        let at = self.at;
        let tree = if self.eat("-") {
            Ast::One(Fun1::Neg, Box::new(self.factor()?), at)
        } else if self.eat("+") {
            self.factor()?
        } else {
            let base = self.atom()?;
            self.space();
            let at = self.at;
            if self.eat("^") {
                let exponent = self.factor()?;
                Ast::Two(Fun2::Pow, Box::new(base), Box::new(exponent), at)
            } else {
                base
            }
        };
        self.depth -= 1;
        Ok(tree)
    }

    fn atom(&mut self) -> Result<Ast> {
        self.space();
        let at = self.at;
        let rest = &self.source[at..];
        let Some(first) = rest.chars().next() else {
            let what = if at == 0 { "the expression is empty" } else { "the expression ends where a value belongs" };
            return Err(self.error(at, what.into()));
        };
        if first.is_ascii_digit() || first == '.' {
            return self.number();
        }
        if first == '(' {
            self.at += 1;
            let inner = self.expression()?;
            if !self.eat(")") {
                return Err(self.error(at, "this bracket is not closed".into()));
            }
            return Ok(inner);
        }
        if first.is_alphabetic() || first == '_' {
            let length = rest.find(|c: char| !c.is_alphanumeric() && c != '_').unwrap_or(rest.len());
            self.at += length;
            let name = &rest[..length];
            self.space();
            if self.source[self.at..].starts_with('(') {
                return self.call(name, at);
            }
            if FUNCTIONS.contains(&name) {
                return Err(self.error(at, format!("`{name}` is a function; write `{name}(...)`")));
            }
            return Ok(Ast::Name(name.to_string(), at));
        }
        Err(self.error(at, format!("expected a number, a name or a bracket, found `{first}`")))
    }

    fn number(&mut self) -> Result<Ast> {
        let rest = &self.source[self.at..];
        let bytes = rest.as_bytes();
        let mut end = bytes.iter().position(|b| !b.is_ascii_digit() && *b != b'.').unwrap_or(bytes.len());
        if bytes.get(end).is_some_and(|b| matches!(b, b'e' | b'E')) {
            let sign = usize::from(bytes.get(end + 1).is_some_and(|b| matches!(b, b'+' | b'-')));
            let digits = bytes[end + 1 + sign..].iter().take_while(|b| b.is_ascii_digit()).count();
            if digits > 0 {
                end += 1 + sign + digits;
            }
        }
        let text = &rest[..end];
        match text.parse::<f64>() {
            Ok(v) if v.is_finite() => {
                self.at += end;
                Ok(Ast::Number(v))
            }
            _ => Err(self.error(self.at, format!("`{text}` is not a finite number"))),
        }
    }

    fn call(&mut self, name: &str, at: usize) -> Result<Ast> {
        self.at += 1; // the opening bracket
        let mut arguments = Vec::new();
        if !self.eat(")") {
            loop {
                arguments.push(self.expression()?);
                if self.eat(")") {
                    break;
                }
                if !self.eat(",") {
                    return Err(self.error(self.at, format!("expected `,` or `)` in the call of `{name}`")));
                }
            }
        }
        let count = |wanted: usize| {
            if arguments.len() == wanted {
                return Ok(());
            }
            let found = arguments.len();
            Err(self.error(at, format!("`{name}` takes {wanted} argument{}, found {found}", plural(wanted))))
        };
        if name == "if" {
            count(3)?;
            let three: [Ast; 3] = arguments.try_into().expect("counted");
            return Ok(Ast::If(Box::new(three), at));
        }
        if let Some((_, f)) = ONE.iter().find(|(n, _)| *n == name) {
            count(1)?;
            return Ok(Ast::One(*f, Box::new(arguments.remove(0)), at));
        }
        if let Some((_, f)) = TWO.iter().find(|(n, _)| *n == name) {
            count(2)?;
            let first = arguments.remove(0);
            return Ok(Ast::Two(*f, Box::new(first), Box::new(arguments.remove(0)), at));
        }
        let near = nearest(name, FUNCTIONS);
        Err(self.error(at, format!("there is no function `{name}`{}", suggestion(&near))))
    }
}

fn plural(n: usize) -> &'static str {
    if n == 1 { "" } else { "s" }
}

/// `; did you mean ...?` for a list of near names, or nothing.
pub fn suggestion(near: &[String]) -> String {
    match near {
        [] => String::new(),
        [one] => format!("; did you mean `{one}`?"),
        many => {
            format!("; did you mean one of {}?", many.iter().map(|n| format!("`{n}`")).collect::<Vec<_>>().join(", "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn text(e: &str) -> String {
        parse(e, "flow.v").unwrap_err().to_string()
    }

    #[test]
    fn power_binds_tighter_than_the_sign() {
        let Ast::One(Fun1::Neg, inner, _) = parse("-x^2", "p").unwrap() else { panic!("a negation") };
        assert!(matches!(*inner, Ast::Two(Fun2::Pow, ..)));
        assert!(matches!(parse("2^-3", "p").unwrap(), Ast::Two(Fun2::Pow, ..)));
    }

    #[test]
    fn errors_point() {
        assert!(text("a + ").contains("ends where a value belongs"));
        assert!(text("cso(x)").contains("`cos`"));
        assert!(text("sin(x, y)").contains("takes 1 argument"));
        assert!(text("x ** 2").contains('^'));
        assert!(text("(a + b").contains("not closed"));
        assert!(text("a = b").contains("=="));
        assert!(text("").contains("empty"));
        let Error::Expression { line, column, .. } = parse("a +\n  @", "p").unwrap_err() else { panic!() };
        assert_eq!((line, column), (2, 3));
    }

    #[test]
    fn deep_nesting_is_refused_not_a_crash() {
        assert!(text(&"(".repeat(100_000)).contains("nested deeper"));
        assert!(text(&"q+".repeat(200_000)).contains("more than 2000 operators"));
    }
}
