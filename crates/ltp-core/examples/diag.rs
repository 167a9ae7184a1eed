//! scratch
use ltp_core::{diagnose::{diagnose, Control, Options}, model::Model, signal::Recording};
use std::sync::atomic::AtomicBool;
fn read(path:&str)->Recording{
  let text=std::fs::read_to_string(path).unwrap(); let mut lines=text.lines();
  let head:Vec<String>=lines.next().unwrap().split(',').map(String::from).collect();
  let mut cols=vec![Vec::new();head.len()];
  for l in lines { for (c,v) in cols.iter_mut().zip(l.split(',')) { c.push(v.parse().unwrap()); } }
  let (mut i,mut o,mut inn,mut on)=(vec![],vec![],vec![],vec![]);
  for (h,c) in head.iter().zip(&cols).skip(1) { if let Some(n)=h.strip_prefix("u:") {i.push(c.clone());inn.push(n.to_string())} else {o.push(c.clone());on.push(h[2..].to_string())} }
  Recording::new(path,cols[0].clone(),i,o,inn,on).unwrap()
}
fn main(){
  let a:Vec<String>=std::env::args().collect();
  let m=Model::from_toml(&std::fs::read_to_string(&a[1]).unwrap(),&a[1]).unwrap_or_else(|e|panic!("{e}"));
  let train:Vec<_>=a[2].split(',').map(read).collect();
  let test:Vec<_>=a.get(3).map_or(vec![],|s|s.split(',').map(read).collect());
  let c=AtomicBool::new(false);
  let t=std::time::Instant::now();
  let p=|s:&str,f:f64| eprintln!("{:.2}s {f:.2} {s}",t.elapsed().as_secs_f64());
  let mut options=Options::default();
  if let Some(x)=a.get(4) { options.candidates=Some(x.split(',').map(String::from).collect()); }
  let d=diagnose(&m,&train,&test,&options,&Control{cancelled:&c,progress:&p}).unwrap_or_else(|e|panic!("{e}"));
  println!("{:?}\n{}",d.verdict,d.sentence);
  println!("{:?}",d.location);
  for e in &d.effects {println!("{e:?}");}
  for c in &d.candidates {println!("{:>20}@{:8} score {:?} held {:?} conv {} {:?} {:?}",c.name,c.at,c.score.map(|s|s.round()),c.held_out.map(|s|s.round()),c.converged,c.parameters,c.note);}
  for (n,p) in &d.parameters {println!("{n} {p:?}");}
  for r in d.fit.train.iter().chain(&d.fit.test) {println!("{r:?}");}
  println!("{:?} {}",d.warnings,d.seconds);
}
