use recorded::*;
use calibration::Calibrated; use pins::*; use fixed::Settings; use rayon::prelude::*;
fn main()->anyhow::Result<()>{
  let mut args=std::env::args().skip(1);
  let folder=args.next().unwrap(); let what=args.next().unwrap_or_default();
  let only=args.next(); let step=args.next().map_or(3,|s|s.parse().unwrap());
  let r=importers::stanford_in_space(std::path::Path::new(&folder))?;
  for (ci,c) in r.calibrations.iter().enumerate(){
    if only.as_ref().is_some_and(|o|!c.name.contains(o.as_str())){continue}
    let t=std::time::Instant::now();
    let k=match Calibrated::new(c){Ok(k)=>k,Err(e)=>{println!("{}: {e:#}",c.name);continue}};
    let h=k.process.held_out(&k.neighbours);
    let rms=|h:&[process::HeldOut]|(h.iter().map(|h|h.error.norm_squared()).sum::<f64>()/(2*h.len()) as f64).sqrt()/k.process.largest_counts*100.;
    let z:f64=h.iter().map(|h|h.error.component_div(&h.sd).norm_squared()).sum::<f64>()/(2*h.len()) as f64;
    println!("{} n {} out {} rms {:.3}% z2 {:.2} {:?} rest {:?}",c.name,k.samples.len(),k.outliers,rms(&h),z,t.elapsed(),k.rest_counts);
    for q in &k.process.kernels{println!("  {q:?}")}
    let paper=process::Process::new(&k.process.samples,[paper::kernel();2]).unwrap();
    let set=Settings::default();
    if what.contains('l'){
      let least=TOUCH*k.process.largest_counts;
      let s:Vec<_>=(0..k.neighbours.len()).into_par_iter().step_by(step).filter_map(|l|{
        let rows=line(&k,l); let touch=touch(&rows,least)?;
        let p=k.process.without(&k.neighbours[l]); let q=paper.without(&k.neighbours[l]);
        Some((score("l",&format!("{l}"),"fixed",&replay(Method::Fixed(&p,set),&touch)),score("l",&format!("{l}"),"paper",&replay(Method::Paper(&q,l as u64),&touch))))
      }).collect();
      for which in 0..2{ let mut v:Vec<_>=s.iter().filter_map(|s|if which==0{s.0.clone()}else{s.1.clone()}).collect();
        v.sort_by(|a,b|a.mean_m.total_cmp(&b.mean_m)); let n=v.len() as f64;
        println!(" lines {} n {} mean {:.3} med {:.3} p90 {:.3} worst {:.3} nees {:.2} cov {:.2}",["fixed","paper"][which],n,v.iter().map(|s|s.mean_m).sum::<f64>()/n*1e3,v[v.len()/2].mean_m*1e3,v[v.len()*9/10].mean_m*1e3,v.iter().map(|s|s.worst_m).fold(0.,f64::max)*1e3,v.iter().map(|s|s.nees).sum::<f64>()/n,v.iter().map(|s|s.coverage).sum::<f64>()/n);
        if which==0 {for s in v.iter().rev().take(5){println!("    {} {:.3} worst {:.3} sd {:.3} rows {}/{}",s.name,s.mean_m*1e3,s.worst_m*1e3,s.sd_m*1e3,s.rows,s.all_rows)}}
      }
    }
    if what.contains('o'){
      let p=k.process.without(&[]); let least=TOUCH*k.process.largest_counts;
      r.sweeps.par_iter().filter(|t|t.calibration==ci).for_each(|t|{
        let rot=nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::z_axis(),std::f64::consts::PI);
        let Some(first)=t.rows.iter().position(|r|r.1.norm()>least) else{return};
        let last=first+t.rows[first..].iter().position(|r|r.1.norm()<=least).unwrap_or(t.rows.len()-first);
        let touch:Vec<_>=t.rows[first.saturating_sub(1)..last].iter().map(|r|fixed::Reading{rotation:rot,origin_m:r.0,counts:r.1}).collect();
        let tm=std::time::Instant::now();
        let c=sweep::contacts(&p,&k.root_m,&touch,&sweep::SweepSettings::default());
        let got:Vec<_>=c.iter().flatten().copied().collect();
        let mut d:Vec<f64>=t.mesh.as_ref().map(|m|got.iter().map(|g|mesh::distance_m(g,m)*1e3).collect()).unwrap_or_default();
        let ext:f64=got.windows(2).map(|w|(w[1]-w[0]).norm()).sum::<f64>()*1e3;
        println!("  {} rows {} of {} extent {:.1} z {:.1}",t.name,got.len(),c.len(),ext, touch[0].origin_m.z*1e3);
        if std::env::var("V").is_ok(){for (i,(g,r)) in c.iter().zip(&touch[1..]).enumerate().step_by(8){if let Some(g)=g{let s=r.to_sensor(g);let n=sweep::normal(&p,&k.root_m,&s);println!("    {i} obj {:.2} {:.2} {:.2} sens {:.2} {:.2} {:.2} n {:?} d {:.3}",g.x*1e3,g.y*1e3,g.z*1e3,s.x*1e3,s.y*1e3,s.z*1e3,n.map(|n|[(n.x*100.).round(),(n.y*100.).round()]),t.mesh.as_ref().map_or(0.,|m|mesh::distance_m(g,m)*1e3))}}}
        if d.len()>3{let m=d.iter().sum::<f64>()/d.len() as f64;d.sort_by(f64::total_cmp);println!("  {} mean {:.3} p95 {:.3} max {:.3} {:?}",t.name,m,d[d.len()*95/100],d[d.len()-1],tm.elapsed());}
      });
    }
    if what.contains('p'){
      let p=k.process.without(&[]); let q=paper.without(&[]);
      let least=TOUCH*k.process.largest_counts;
      let trials:Vec<_>=r.pins.iter().filter(|t|t.calibration==ci).filter_map(|t|Some((t,touch(&t.rows,least)?))).collect();
      let Some(first)=trials.first() else{continue};
      let m=Mounting::learnt(&p,&first.1,&nalgebra::Vector3::zeros()); println!(" {m:?}");
      trials.par_iter().enumerate().for_each(|(i,(t,touch))|{
        let learnt:Vec<_>=touch.iter().map(|r|m.corrected(r)).collect();
        for (lab,s) in [("fixed",score("p",&t.name,"f",&replay(Method::Fixed(&p,set),touch))),("learnt",score("p",&t.name,"f",&replay(Method::Fixed(&p,set),&learnt))),("paper",score("p",&t.name,"p",&replay(Method::Paper(&q,i as u64),touch)))]{
          if let Some(s)=s{println!("  {} {lab} mean {:.3} worst {:.3} nees {:.2} cov {:.2} sd {:.3} rows {}/{}",s.name,s.mean_m*1e3,s.worst_m*1e3,s.nees,s.coverage,s.sd_m*1e3,s.rows,s.all_rows)}
        }});
    }
  }
  Ok(())
}
