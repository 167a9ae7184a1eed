//! The noun `Model`: equations as data, differentiated exactly and compiled to native code.
//!
//! Read in order: [`document`] (the tree a file holds), [`parse`] (expressions), [`units`], [`effects`] (the library of
//! candidate physics), [`attach`] (where they act), [`graph`] (shared expressions), `derivative`, [`mod@assemble`] (names and
//! equations), `port_laws`, [`contact`] and [`delay`] (what effects do), [`friction`] (slip and stick), [`tape`] and [`native`]
//! (evaluation), [`stepper`] (a whole step as one program), [`system`] (the trait simulation works on).

pub mod assemble;
pub mod attach;
pub mod check_units;
pub mod compiled;
pub mod contact;
pub mod delay;
mod derivative;
pub mod document;
pub mod effects;
pub mod friction;
pub mod graph;
pub mod mass_matrix;
pub mod native;
pub mod parse;
mod port_laws;
pub mod program;
pub mod scope;
mod slopes;
pub mod stepper;
pub mod system;
pub mod tape;
pub mod units;
pub mod zoo;

pub use assemble::ParameterInfo;
pub use compiled::Compiled;
pub use document::{Attached, Definition, Document, FullDefinition};
pub use effects::{Effect, Library};
pub use program::Backend;
pub use stepper::Stepper;
pub use system::{Delay, Direction, Guard, Operator, Past, Point, Schedule, System};
pub use zoo::{ZOO, zoo, zoo_text};

use crate::error::{Error, Result, nearest};
use assemble::{Assembly, assemble, place};
use friction::Product;

/// A model whose document has been read, resolved and checked: a value that exists is consistent.
#[derive(Clone)]
pub struct Model {
    document: Document,
    library: Library,
    source: String,
    assembly: Assembly,
    product: Product,
}

impl Model {
    /// Gives a document its meaning; `source` is the file name in messages.
    ///
    /// # Errors
    /// Every way in which a document can be wrong, naming the place.
    pub fn new(document: Document, library: Library, source: &str) -> Result<Self> {
        let assembly = assemble(&document, &library, source)?;
        check_units::check(&document, source)?;
        let product = Product::new(&assembly, source)?;
        Ok(Self { document, library, source: source.to_string(), assembly, product })
    }

    /// Reads TOML with the library that ships with the crate.
    ///
    /// # Errors
    /// As [`Model::new`].
    pub fn from_toml(text: &str, source: &str) -> Result<Self> {
        Self::new(Document::from_toml(text, source)?, Library::shipped()?, source)
    }

    /// The same model with effects of one's own in its library, each a name and the TOML text of its document.
    ///
    /// # Errors
    /// [`Error::Document`] for a text that is no effect, or a name that is taken.
    pub fn with_effects<S: AsRef<str>>(&self, own: &[(S, S)]) -> Result<Self> {
        let mut library = self.library.clone();
        for (name, text) in own {
            library.add_toml(name.as_ref(), text.as_ref())?;
        }
        Ok(Self { library, ..self.clone() })
    }

    /// The document.
    pub fn document(&self) -> &Document {
        &self.document
    }

    /// The effects library this model was made with.
    pub fn library(&self) -> &Library {
        &self.library
    }

    /// Name of the model.
    pub fn name(&self) -> &str {
        &self.document.name
    }

    /// Parameters, the document's first, then those of attached effects.
    pub fn parameters(&self) -> &[ParameterInfo] {
        &self.assembly.parameters
    }

    /// Names of the states, the document's first, then those of attached effects.
    pub fn states(&self) -> &[String] {
        &self.assembly.states
    }

    /// Names of the inputs.
    pub fn inputs(&self) -> Vec<&str> {
        self.document.inputs.keys().map(String::as_str).collect()
    }

    /// Names of the outputs.
    pub fn outputs(&self) -> Vec<&str> {
        self.document.outputs.keys().map(String::as_str).collect()
    }

    /// Names of the document's modes; one, `motion`, where it names none.
    pub fn modes(&self) -> Vec<&str> {
        self.assembly.modes.iter().map(|m| m.name.as_str()).collect()
    }

    /// Names of the ports.
    pub fn ports(&self) -> Vec<&str> {
        self.document.ports.keys().map(String::as_str).collect()
    }

    /// Index of a parameter.
    ///
    /// # Errors
    /// [`Error::UnknownName`] with the nearest names.
    pub fn parameter(&self, name: &str) -> Result<usize> {
        let all = || self.parameters().iter().map(|p| p.name.as_str());
        all().position(|p| p == name).ok_or_else(|| Error::UnknownName {
            kind: "parameter".into(),
            name: name.into(),
            nearest: nearest(name, all()),
            context: place(&self.source, "parameters"),
        })
    }

    /// Index of a mode.
    ///
    /// # Errors
    /// [`Error::UnknownName`] with the nearest names.
    pub fn mode(&self, name: &str) -> Result<usize> {
        let all = || self.assembly.modes.iter().map(|m| m.name.as_str());
        let base = all().position(|m| m == name).ok_or_else(|| Error::UnknownName {
            kind: "mode".into(),
            name: name.into(),
            nearest: nearest(name, all()),
            context: place(&self.source, "modes"),
        })?;
        Ok(self.product.join(base, &vec![friction::Contact::Forward; self.product.elements]))
    }

    /// The parameters that fitting may move: those with an uncertainty, and those of attached effects.
    pub fn uncertain(&self) -> Vec<usize> {
        let free = |p: &ParameterInfo| p.sd.is_some() || p.effect.is_some();
        self.parameters().iter().enumerate().filter(|(_, p)| free(p)).map(|(i, _)| i).collect()
    }

    /// Compiles the model; derivatives are taken for [`Model::uncertain`].
    pub fn compile(&self) -> Compiled {
        self.compile_for(self.uncertain(), Backend::Native)
    }

    /// Which states rest in the starting mode and move in another, as the foot of a hopper that stands at first: a run that
    /// starts there has them where the document says.
    pub fn held_at_start(&self) -> Vec<bool> {
        let doc = &self.document;
        let first = doc.initial_mode.as_ref().or_else(|| doc.modes.keys().next());
        let rests = |mode: &document::Mode, state: &String| {
            let flow = mode.flow.get(state).or_else(|| doc.flow.get(state));
            flow.is_some_and(|text| text.trim().parse::<f64>().is_ok_and(|v| v == 0.0))
        };
        let start = first.and_then(|name| doc.modes.get(name));
        let held = |state| start.is_some_and(|m| rests(m, state) && !doc.modes.values().all(|m| rests(m, state)));
        doc.states.keys().map(held).collect()
    }

    /// Compiles the model for chosen derivatives and evaluator.
    pub fn compile_for(&self, free: Vec<usize>, backend: Backend) -> Compiled {
        Compiled::new(self.assembly.clone(), self.product.clone(), self.document.inputs.len(), free, backend)
    }

    /// The model with an effect attached at a port, an input (or a signal that inputs enter), an output, a contact or a
    /// parameter, whichever the effect acts on. Parameters that are not given take the default of the effect's document.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for the effect, the place or a parameter; [`Error::Model`] where the effect has nothing to act
    /// on there.
    pub fn attach(&self, effect: &str, at: &str, parameters: &[(&str, f64)]) -> Result<Model> {
        let mut document = self.document.clone();
        let value = |(n, v): &(&str, f64)| ((*n).to_string(), document::Parameter { value: *v, ..Default::default() });
        let parameters = parameters.iter().map(value).collect();
        let on = &self.library.get(effect)?.on;
        if on == "input"
            && self.document.signals.contains_key(at)
            && !attach::candidates(&self.document, on).contains(&at)
        {
            let path = place(&self.source, &format!("effects[{effect}@{at}]"));
            let message = format!("no input enters the signal `{at}`: attach this where one does, or at an input");
            return Err(Error::Model { path, message });
        }
        document.effects.push(Attached { name: effect.into(), at: at.into(), parameters });
        Model::new(document, self.library.clone(), &self.source)
    }

    /// Where an effect may act in this model, in document order: all its ports, inputs and then signals that inputs enter,
    /// outputs, contacts or parameters at which [`Model::attach`] succeeds.
    ///
    /// Of the signals, those are offered that states do not enter: what drives the model, such as a whole actuator.
    /// Of the parameters, `parameter_error` is offered the exact ones (a fit moves the others by itself), any other effect
    /// those with an uncertainty; both may be attached to all.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for an effect that does not exist.
    pub fn places(&self, effect: &str) -> Result<Vec<String>> {
        let on = self.library.get(effect)?.on.as_str();
        let wanted = |at: &str| {
            let exact = self.document.parameters.get(at).is_none_or(|p| p.sd.is_none_or(|sd| sd == 0.0));
            let answers = on == "input" && attach::state_enters(&self.document, at);
            !answers && (on != "parameter" || exact == (effect == "parameter_error"))
        };
        let names = attach::candidates(&self.document, on).into_iter().filter(|at| wanted(at));
        Ok(names.filter(|at| self.attach(effect, at, &[]).is_ok()).map(String::from).collect())
    }

    /// The model with one more effect in its library.
    ///
    /// # Errors
    /// [`Error::Document`] for an effect that is not one, or a name that is taken.
    pub fn with_effect(&self, name: &str, effect: Effect) -> Result<Model> {
        let mut library = self.library.clone();
        library.add(name, effect)?;
        Model::new(self.document.clone(), library, &self.source)
    }

    /// The model with other values, and uncertainties where given, of some parameters (also of effects).
    ///
    /// # Errors
    /// [`Error::UnknownName`] and what [`Model::new`] says of the values.
    pub fn with_parameters(&self, values: &[(&str, f64, Option<f64>)]) -> Result<Model> {
        let mut document = self.document.clone();
        for (name, value, sd) in values {
            let info = &self.parameters()[self.parameter(name)?];
            let entry = match info.effect {
                None => document.parameters.get_mut(*name),
                Some(k) => {
                    let own = name.rsplit('.').next().unwrap_or(name);
                    Some(document.effects[k].parameters.entry(own.to_string()).or_default())
                }
            };
            if let Some(p) = entry {
                p.value = *value;
                p.sd = sd.or(p.sd);
                p.unit = p.unit.take().or_else(|| info.unit.clone());
            }
        }
        Model::new(document, self.library.clone(), &self.source)
    }

    /// The model with some inputs replaced by expressions, such as `("tau", "2*sin(3*t)")`: exact between samples.
    ///
    /// These inputs become signals, and further outputs at the end, in the order given, so that a simulation shows them.
    /// Numbers in the expressions carry the units of the inputs, so units are not checked again.
    ///
    /// # Errors
    /// [`Error::UnknownName`] for an input, [`Error::Expression`] for what cannot be read.
    pub fn with_input_expressions(&self, expressions: &[(&str, &str)]) -> Result<Model> {
        let mut document = self.document.clone();
        for (name, expression) in expressions {
            let input = document.inputs.shift_remove(*name).ok_or_else(|| Error::UnknownName {
                kind: "input".into(),
                name: (*name).into(),
                nearest: nearest(name, self.document.inputs.keys().map(String::as_str)),
                context: place(&self.source, "inputs"),
            })?;
            let full = |value: &str| {
                Definition::Full(FullDefinition { value: value.into(), unit: input.unit.clone(), column: None })
            };
            document.signals.insert((*name).into(), full(expression));
            let mut shown = format!("input {name}");
            while document.outputs.contains_key(&shown) {
                shown.push('\'');
            }
            document.outputs.insert(shown, full(expression)); // as given, whatever an effect makes of it
        }
        let assembly = assemble(&document, &self.library, &self.source)?;
        let product = Product::new(&assembly, &self.source)?;
        Ok(Self { document, assembly, product, ..self.clone() })
    }

    /// The document as TOML.
    ///
    /// # Errors
    /// [`Error::Document`].
    pub fn to_toml(&self) -> Result<String> {
        self.document.to_toml()
    }

    /// Unit of a state, input, output, parameter or signal; `1` where none is declared.
    ///
    /// # Errors
    /// [`Error::UnknownName`].
    pub fn unit(&self, name: &str) -> Result<&str> {
        let d = &self.document;
        let found = d
            .outputs
            .get(name)
            .and_then(|o| o.unit().or_else(|| d.states.get(o.expression().trim())?.unit.as_deref()))
            .or_else(|| d.states.get(name)?.unit.as_deref())
            .or_else(|| d.inputs.get(name)?.unit.as_deref())
            .or_else(|| d.signals.get(name)?.unit())
            .or_else(|| self.parameters().iter().find(|p| p.name == name)?.unit.as_deref());
        if let Some(unit) = found {
            return Ok(unit);
        }
        let mut names = d.outputs.keys().chain(d.states.keys()).chain(d.inputs.keys()).chain(d.signals.keys());
        if names.any(|n| n == name) {
            return Ok("1");
        }
        self.parameter(name).map(|_| "1")
    }

    /// Column of an input or output in recordings.
    ///
    /// # Errors
    /// [`Error::UnknownName`].
    pub fn column<'a>(&'a self, name: &'a str) -> Result<&'a str> {
        if let Some(i) = self.document.inputs.get(name) {
            return Ok(i.column.as_deref().unwrap_or(name));
        }
        if let Some(o) = self.document.outputs.get(name) {
            return Ok(o.column().unwrap_or(name));
        }
        let known = self.document.inputs.keys().chain(self.document.outputs.keys()).map(String::as_str);
        Err(Error::UnknownName {
            kind: "input or output".into(),
            name: name.into(),
            nearest: nearest(name, known),
            context: place(&self.source, "model"),
        })
    }

    /// The model's starting mode with dry friction set apart, for the plain evaluator; `None` for a hybrid model or
    /// one with late inputs.
    pub fn parts(&self) -> Option<friction::Parts> {
        let a = &self.assembly;
        let smooth = a.modes.len() == 1 && a.events.is_empty() && a.ticks.is_empty() && a.delays.is_empty();
        smooth.then(|| friction::parts(a, a.initial_mode))
    }

    /// Every mode and event with dry friction set apart, for the plain evaluator, and the starting mode; `None` for a model
    /// with sampled updates or late inputs.
    pub fn all_parts(&self) -> Option<(Vec<friction::Parts>, Vec<friction::EventParts>, usize)> {
        let a = &self.assembly;
        let modes = || (0..a.modes.len()).map(|m| friction::parts(a, m)).collect();
        (a.ticks.is_empty() && a.delays.is_empty()).then(|| (modes(), friction::event_parts(a), a.initial_mode))
    }

    /// Position and velocity of a port in the starting mode, ready to be evaluated.
    ///
    /// # Errors
    /// [`Error::UnknownName`].
    pub fn port_motion(&self, port: &str) -> Result<program::Program> {
        let (position, velocity) = self.assembly.modes[self.assembly.initial_mode].ports[self.port(port)?];
        Ok(program::Program::plain(&self.assembly.graph, &[position, velocity]))
    }

    /// Units of a port's force, position and velocity.
    ///
    /// # Errors
    /// [`Error::UnknownName`], [`Error::Unit`].
    pub fn port_units(&self, port: &str) -> Result<[String; 3]> {
        let j = self.port(port)?;
        let unit =
            |word: &str| attach::place_unit(word, &self.document, attach::Place::Port(j), port).map(|u| u.to_string());
        Ok([unit("force")?, unit("position")?, unit("velocity")?])
    }

    fn port(&self, port: &str) -> Result<usize> {
        self.document.ports.get_index_of(port).ok_or_else(|| Error::UnknownName {
            kind: "port".into(),
            name: port.into(),
            nearest: nearest(port, self.ports()),
            context: place(&self.source, "ports"),
        })
    }
}
