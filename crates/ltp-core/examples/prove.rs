//! scratch
use ltp_core::{conceal::{conceal,Recipe}, diagnose::{diagnose,Control,Options}, model::zoo};
use std::sync::atomic::AtomicBool;
fn main(){
  let a:Vec<String>=std::env::args().collect();
  let snr:f64=a[2].parse().unwrap(); let size:f64=a[3].parse().unwrap(); let amp:f64=a[4].parse().unwrap();
  let m=zoo(&a[1]).unwrap();
  let mut effects:Vec<String>=m.library().names().map(String::from).collect(); effects.push("nothing".into());
  let c=AtomicBool::new(false); let p=|_:&str,_:f64|{};
  let (mut n,mut ok)=(0,0);
  for seed in a[5].split(',').map(|s|s.parse::<u64>().unwrap()) { for port in m.ports() { for e in effects.iter().filter(|e| a.get(6).is_none_or(|x| x==*e)) {
    if e=="nothing" && port!=m.ports()[0] {continue}
    let r=Recipe{effect:Some((e.clone(),port.to_string())),snr,size,amplitude:amp,model:a[1].clone(),..Recipe::demo(seed)};
    let case=match conceal(&r){Ok(c)=>c,Err(x)=>{println!("{e}@{port}: {x}");continue}};
    let d=match diagnose(&case.model,&case.train,&case.test,&Options::default(),&Control{cancelled:&c,progress:&p}){Ok(d)=>d,Err(x)=>{println!("{e}@{port}: {x}");continue}};
    let found=d.effects.first().map(|f|format!("{}@{} {:?}",f.name,f.at,f.parameters.iter().map(|(k,v)|format!("{k}={:.4}±{:.4}",v.value,v.sd.unwrap_or(0.))).collect::<Vec<_>>())).unwrap_or_default();
    let good=d.effects.first().map_or(e=="nothing",|f|&f.name==e && f.at==port);
    n+=1; ok+=good as i32;
    let r=&d.fit.test;
    println!("{} {e}@{port} {:?} truth {:?} -> {found} amb {:?} | {:?} | {} | {:.1}s", if good {"ok  "} else {"MISS"}, d.verdict, case.label.parameters.iter().map(|p|format!("{:.4}",p.1)).collect::<Vec<_>>(), d.ambiguous_with, d.location.as_ref().map(|l|(l.at.clone(),l.variable.clone(),l.p_value)), r.iter().map(|r|format!("{:.4}->{:.4} ({:.4})",r.before.unwrap_or(-1.),r.after.unwrap_or(-1.),r.floor)).collect::<Vec<_>>().join(", "), d.seconds);
    if !good { for c in d.candidates.iter().take(4) { println!("      {}@{} {:?} {:?} {:?}",c.name,c.at,c.score,c.held_out,c.parameters);} }
  }}}
  println!("{ok}/{n}");
}
