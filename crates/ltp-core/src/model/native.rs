//! Native code: tapes compiled by Cranelift at load. **The only file of the core with unsafe code.**
//!
//! Each program becomes one function `f(t, x, u, p, out)`. Operations are the ones of [`super::graph::apply1`] and
//! [`super::graph::apply2`] in the same order, without contraction, so that results equal the plain evaluator's bit for
//! bit. Where the machine has no back end or forbids executable memory, [`compile`] gives `None` and the plain evaluator
//! serves.
#![allow(unsafe_code)]

use std::sync::Arc;

use cranelift_codegen::ir::condcodes::FloatCC;
use cranelift_codegen::ir::{AbiParam, Function, InstBuilder, MemFlagsData, Signature, UserFuncName, Value, types};
use cranelift_codegen::settings::{self, Configurable};
use cranelift_frontend::{FunctionBuilder, FunctionBuilderContext};
use cranelift_jit::{JITBuilder, JITModule};
use cranelift_module::{FuncId, Linkage, Module};

use super::graph::{Fun1, Fun2, apply1, apply2};
use super::tape::{Instruction, Point, Tape};

type Entry = unsafe extern "C" fn(f64, *const f64, *const f64, *const f64, *mut f64);

/// Executable memory of one compiled model; freed when the last function that lives in it is dropped.
struct Code(Option<JITModule>);

// SAFETY: after finalisation the module is never called again except to free its memory in `drop`; the code itself is
// immutable and works on its arguments and the stack only.
unsafe impl Send for Code {}
// SAFETY: as above; no method takes `&self`.
unsafe impl Sync for Code {}

impl Drop for Code {
    fn drop(&mut self) {
        if let Some(module) = self.0.take() {
            // SAFETY: every `Native` holds an `Arc` of this, so no function pointer into the memory is left.
            unsafe { module.free_memory() };
        }
    }
}

/// A compiled program.
#[derive(Clone)]
pub struct Native {
    entry: Entry,
    needs: [usize; 4],
    _code: Arc<Code>,
}

impl Native {
    /// Evaluates into `out`.
    #[inline]
    pub fn eval(&self, at: Point<'_>, out: &mut [f64]) {
        let [x, u, p, o] = self.needs;
        assert!(
            at.x.len() >= x && at.u.len() >= u && at.p.len() >= p && out.len() >= o,
            "slices shorter than the model"
        );
        // SAFETY: the code reads at most `needs` values from each slice and writes `o` values; lengths checked above.
        unsafe { (self.entry)(at.t, at.x.as_ptr(), at.u.as_ptr(), at.p.as_ptr(), out.as_mut_ptr()) }
    }
}

macro_rules! externs {
    ($($name:ident = $fun:path => $apply:ident, $($a:ident),+);* $(;)?) => {
        $(extern "C" fn $name($($a: f64),+) -> f64 { $apply($fun, $($a),+) })*
        fn symbols() -> Vec<(&'static str, *const u8)> {
            vec![$((stringify!($name), $name as *const u8)),*]
        }
    };
}

externs! {
    ltp_sin = Fun1::Sin => apply1, a; ltp_cos = Fun1::Cos => apply1, a; ltp_tan = Fun1::Tan => apply1, a;
    ltp_asin = Fun1::Asin => apply1, a; ltp_acos = Fun1::Acos => apply1, a; ltp_atan = Fun1::Atan => apply1, a;
    ltp_sinh = Fun1::Sinh => apply1, a; ltp_cosh = Fun1::Cosh => apply1, a; ltp_tanh = Fun1::Tanh => apply1, a;
    ltp_exp = Fun1::Exp => apply1, a; ltp_log = Fun1::Log => apply1, a;
    ltp_pow = Fun2::Pow => apply2, a, b; ltp_atan2 = Fun2::Atan2 => apply2, a, b;
}

fn extern1(f: Fun1) -> Option<&'static str> {
    Some(match f {
        Fun1::Sin => "ltp_sin",
        Fun1::Cos => "ltp_cos",
        Fun1::Tan => "ltp_tan",
        Fun1::Asin => "ltp_asin",
        Fun1::Acos => "ltp_acos",
        Fun1::Atan => "ltp_atan",
        Fun1::Sinh => "ltp_sinh",
        Fun1::Cosh => "ltp_cosh",
        Fun1::Tanh => "ltp_tanh",
        Fun1::Exp => "ltp_exp",
        Fun1::Log => "ltp_log",
        Fun1::Neg | Fun1::Sqrt | Fun1::Abs | Fun1::Sign => return None,
    })
}

/// Compiles tapes into one piece of executable memory; `None` where this machine cannot.
pub fn compile(tapes: &[&Tape]) -> Option<Vec<Native>> {
    let mut flags = settings::builder();
    flags.set("opt_level", "speed").ok()?;
    flags.set("is_pic", "false").ok()?;
    let isa = cranelift_native::builder().ok()?.finish(settings::Flags::new(flags)).ok()?;
    let mut builder = JITBuilder::with_isa(isa, cranelift_module::default_libcall_names());
    builder.symbols(symbols());
    let mut module = JITModule::new(builder);
    let ids = tapes.iter().map(|t| define(&mut module, t)).collect::<Option<Vec<_>>>()?;
    module.finalize_definitions().ok()?;
    let pointers: Vec<*const u8> = ids.iter().map(|&id| module.get_finalized_function(id)).collect();
    let code = Arc::new(Code(Some(module)));
    let native = |(tape, pointer): (&&Tape, *const u8)| {
        // SAFETY: the function was just defined with exactly this signature.
        let entry: Entry = unsafe { std::mem::transmute::<*const u8, Entry>(pointer) };
        Native { entry, needs: needs(tape), _code: Arc::clone(&code) }
    };
    Some(tapes.iter().zip(pointers).map(native).collect())
}

/// How many states, inputs, parameters are read and results written.
fn needs(tape: &Tape) -> [usize; 4] {
    let mut n = [0, 0, 0, tape.results.len()];
    for i in &tape.code {
        match *i {
            Instruction::State(i) => n[0] = n[0].max(i + 1),
            Instruction::Input(i) => n[1] = n[1].max(i + 1),
            Instruction::Parameter(i) => n[2] = n[2].max(i + 1),
            _ => {}
        }
    }
    n
}

fn define(module: &mut JITModule, tape: &Tape) -> Option<FuncId> {
    let pointer = module.target_config().pointer_type();
    let mut signature = module.make_signature();
    signature.params.push(AbiParam::new(types::F64));
    signature.params.extend([pointer; 4].map(AbiParam::new));
    let id = module.declare_anonymous_function(&signature).ok()?;
    let mut context = module.make_context();
    context.func = Function::with_name_signature(UserFuncName::user(0, id.as_u32()), signature);
    let mut scratch = FunctionBuilderContext::new();
    let mut b = FunctionBuilder::new(&mut context.func, &mut scratch);
    let block = b.create_block();
    b.append_block_params_for_function_params(block);
    b.switch_to_block(block);
    b.seal_block(block);
    let arguments = b.block_params(block).to_vec();
    let trusted = MemFlagsData::trusted();
    let mut v: Vec<Value> = Vec::with_capacity(tape.code.len());
    for i in &tape.code {
        let load = |b: &mut FunctionBuilder<'_>, base: usize, i: usize| {
            b.ins().load(types::F64, trusted, arguments[base], (8 * i) as i32)
        };
        let value = match *i {
            Instruction::Const(c) => b.ins().f64const(c),
            Instruction::Time => arguments[0],
            Instruction::State(i) => load(&mut b, 1, i),
            Instruction::Input(i) => load(&mut b, 2, i),
            Instruction::Parameter(i) => load(&mut b, 3, i),
            Instruction::One(f, a) => one(module, &mut b, f, v[a])?,
            Instruction::Two(f, l, r) => two(module, &mut b, f, v[l], v[r])?,
            Instruction::Select(c, l, r) => {
                let zero = b.ins().f64const(0.0);
                let holds = b.ins().fcmp(FloatCC::NotEqual, v[c], zero);
                b.ins().select(holds, v[l], v[r])
            }
        };
        v.push(value);
    }
    for (k, &r) in tape.results.iter().enumerate() {
        b.ins().store(trusted, v[r], arguments[4], (8 * k) as i32);
    }
    b.ins().return_(&[]);
    b.finalize(module.target_config());
    module.define_function(id, &mut context).ok()?;
    Some(id)
}

fn call(module: &mut JITModule, b: &mut FunctionBuilder<'_>, name: &str, arguments: &[Value]) -> Option<Value> {
    let mut signature: Signature = module.make_signature();
    signature.params.extend(arguments.iter().map(|_| AbiParam::new(types::F64)));
    signature.returns.push(AbiParam::new(types::F64));
    let id = module.declare_function(name, Linkage::Import, &signature).ok()?;
    let local = module.declare_func_in_func(id, b.func);
    let inst = b.ins().call(local, arguments);
    Some(b.inst_results(inst)[0])
}

fn one(module: &mut JITModule, b: &mut FunctionBuilder<'_>, f: Fun1, a: Value) -> Option<Value> {
    if let Some(name) = extern1(f) {
        return call(module, b, name, &[a]);
    }
    Some(match f {
        Fun1::Neg => b.ins().fneg(a),
        Fun1::Sqrt => b.ins().sqrt(a),
        Fun1::Abs => b.ins().fabs(a),
        _ => {
            let (zero, plus, minus) = (b.ins().f64const(0.0), b.ins().f64const(1.0), b.ins().f64const(-1.0));
            let below = b.ins().fcmp(FloatCC::LessThan, a, zero);
            let low = b.ins().select(below, minus, zero);
            let above = b.ins().fcmp(FloatCC::GreaterThan, a, zero);
            b.ins().select(above, plus, low)
        }
    })
}

fn two(module: &mut JITModule, b: &mut FunctionBuilder<'_>, f: Fun2, l: Value, r: Value) -> Option<Value> {
    let order = match f {
        Fun2::Add => return Some(b.ins().fadd(l, r)),
        Fun2::Sub => return Some(b.ins().fsub(l, r)),
        Fun2::Mul => return Some(b.ins().fmul(l, r)),
        Fun2::Div => return Some(b.ins().fdiv(l, r)),
        Fun2::Pow => return call(module, b, "ltp_pow", &[l, r]),
        Fun2::Atan2 => return call(module, b, "ltp_atan2", &[l, r]),
        Fun2::Min | Fun2::Lt => FloatCC::LessThan,
        Fun2::Max | Fun2::Gt => FloatCC::GreaterThan,
        Fun2::Le => FloatCC::LessThanOrEqual,
        Fun2::Ge => FloatCC::GreaterThanOrEqual,
        Fun2::Eq => FloatCC::Equal,
        Fun2::Ne => FloatCC::NotEqual,
    };
    let holds = b.ins().fcmp(order, l, r);
    Some(if matches!(f, Fun2::Min | Fun2::Max) {
        b.ins().select(holds, l, r)
    } else {
        let (yes, no) = (b.ins().f64const(1.0), b.ins().f64const(0.0));
        b.ins().select(holds, yes, no)
    })
}
