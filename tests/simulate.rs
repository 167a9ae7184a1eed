//! Simulation against closed forms.
use ltp_core::model::{System, zoo, Model, Backend};
use ltp_core::simulate::{Inputs, Plan, simulate};

#[test]
fn h1() {
    let t0=std::time::Instant::now();
    let m = zoo("three_mode_hopper").unwrap();
    let c = m.compile_for((0..m.parameters().len()).collect(), Backend::Native);
    c.warm();
    println!("load {:?} native {}", t0.elapsed(), c.is_native());
    println!("{:?}", m.parameters().iter().map(|p|&p.name).collect::<Vec<_>>());
    for h in [1e-2,5e-3,2e-3,1e-3,5e-4] {
        let plan = Plan::new(100.0, 0.1).unwrap().with_step(h);
        let t0=std::time::Instant::now();
        let tr = simulate(&c, c.parameters(), &Inputs::constant(&[]), &plan).unwrap();
        let el=t0.elapsed();
        let n=tr.t.len();
        println!("h {h} {:?} stop {:?} y {:e} events {} last {:e} {:?}", el, tr.stop, tr.states[(n-1)*2]-1.056924001461816, tr.events.len(), tr.events.last().unwrap().time-98.7462181395207, tr.stats);
    }
    let plan = Plan::new(10.0, 0.1).unwrap().with_step(1e-3).with_derivatives();
    let t0=std::time::Instant::now();
    let tr = simulate(&c, c.parameters(), &Inputs::constant(&[]), &plan).unwrap();
    println!("{:?}", t0.elapsed());
    let ns=2+m.parameters().len(); let n=tr.t.len();
    let s=&tr.sensitivities[(n-1)*2*ns..];
    println!("{:?}", s);
}
#[test]
fn zoo_loads() {
    for (name, _) in ltp_core::model::ZOO {
        let t0=std::time::Instant::now();
        let m: Model = match zoo(name) { Ok(m)=>m, Err(e)=>{println!("{name}: {e}"); continue} };
        let c = m.compile();
        c.warm();
        let el=t0.elapsed();
        let plan = Plan::new(3.3, 0.01).unwrap().with_step(1e-3);
        let u = vec![0.0; c.inputs()];
        let tr = simulate(&c, c.parameters(), &Inputs::constant(&u), &plan).unwrap();
        println!("{name} {:?} {:?} {} {:?}", el, tr.stop, tr.events.len(), tr.stats);
    }
}
