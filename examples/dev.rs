use mrvis::*;
use std::time::Instant;
fn main() {
    let args: Vec<String> = std::env::args().collect();
    let t = Instant::now();
    let scene = if args[1].contains('.') { scene::Scene::load(args[1].as_ref(), &Default::default()).unwrap() } else {
        let mut spec = scene::generate::Spec::new(args[1].clone());
        if let Some(x) = args[1].strip_prefix("forest") { let mut it = x.split('x').filter(|x|!x.is_empty()); spec.name="forest".into(); if let Some(a)=it.next(){spec.trees=a.parse().unwrap();} if let Some(a)=it.next(){spec.leaves=a.parse().unwrap();} }
        if let Ok(v)=std::env::var("LIGHT") { spec.light_size=Some(v.parse().unwrap()); } scene::generate::build(&spec).unwrap()
    };
    println!("load {:?} tris {} emitters {} bounds {:?}", t.elapsed(), scene.triangles.len(), scene.emitters.len(), scene.bounds);
    let t = Instant::now();
    let device = embree::Device::new(0).unwrap();
    let mut b = embree::SceneBuilder::new(&device, Default::default()).unwrap();
    b.add_triangles(&scene.positions, &scene.triangles, 1).unwrap();
    let es = b.commit().unwrap();
    println!("embree {:?} {} MB", t.elapsed(), device.bytes()/1000000);
    let t = Instant::now();
    let h = hierarchy::build(&scene, &Default::default());
    println!("hierarchy {:?} clusters {} levels {} leaves {} large {} tri/leaf {:.1}", t.elapsed(), h.micro.clusters.len(), h.micro.levels(), h.micro.clusters.iter().filter(|c|c.is_leaf()).count(), h.large.order.len(), h.micro.order.len() as f64/h.micro.clusters.iter().filter(|c|c.is_leaf()).count().max(1) as f64);
    let t = Instant::now(); h.check(&scene).unwrap(); println!("check {:?}", t.elapsed());
    let t = Instant::now();
    let traits = characterise::characterise(&scene, &h.micro, &Default::default());
    println!("characterise {:?}", t.elapsed());
    let points = bench::workload::surface_points(&scene, std::env::var("PTS").map_or(4000,|v|v.parse().unwrap()), 1).unwrap();
    let w = bench::workload::Workload::new(&scene, points, 1);
    println!("pairs {}", w.pairs.len()); let timer = bench::measure::Timer::new(1).unwrap();
    let mut pk = Vec::new();
    w.packed(&scene, 0..w.pairs.len().min(2000), 16, 0, &mut pk);
    let tr = visibility::fastest_traversal(&es, device.native_width(), &pk);
    println!("{}", tr.name());
    let ex = visibility::Exact{scene:&es, traversal: tr};
    let t = Instant::now();
    let reference = bench::measure::Reference::trace(&scene, &w, ex, 1024, &|_|());
    println!("reference {:?} se {:.5} mean V {:.3}", t.elapsed(), reference.standard_error(), reference.a.iter().sum::<f32>()/reference.a.len() as f32);
    let mut rows=vec![];
    for n in [1,4,16,64,256] { let r = timer.exact(&scene,&w,0..w.pairs.len(),ex,n,&|_|()); let (rms,bias)=reference.errors(&r.visible); println!("exact {n:4} {:.4}s {:.3} us/seg rms {:.5} bias {:+.5}", r.seconds(), r.seconds()*1e6/(n*w.pairs.len()) as f64, rms, bias); rows.push((r.seconds(),rms,n)); }
    let mr = visibility::MultiResolution::new(&scene,&h,&traits,&es,tr,visibility::Leaf::Exact);
    println!("wide MB {} isa {:?}", mr.bytes()/1000000, mr.isa());
    if std::env::var("REP").is_ok() { let s:f32=args[2].parse().unwrap(); for _ in 0..1500 { timer.multi_resolution(&scene,&w,0..w.pairs.len(),&mr,s,std::env::var("RAYS").map_or(16,|v|v.parse().unwrap()),&|_|()); } return; }
    let sizes: Vec<f32> = if args.len()>2 {args[2].split(',').map(|x|x.parse().unwrap()).collect()} else {vec![0.001,0.03,0.1,0.3,1.0]};
    for &s in &sizes { let r = timer.multi_resolution(&scene,&w,0..w.pairs.len(),&mr,s,std::env::var("RAYS").map_or(16,|v|v.parse().unwrap()),&|_|()); let (rms,bias)=reference.errors(&r.run.visible);
      let mut q=[[0.0f64;3];2]; for (i,pr) in w.pairs.iter().enumerate() { let g = (w.points[pr.point as usize].normal.z.abs()>0.9999) as usize; let x=r.run.visible[i]; q[g][0]+=((x-reference.a[i])*(x-reference.b[i])) as f64; q[g][1]+=1.0; q[g][2]+=(x-0.5*(reference.a[i]+reference.b[i])) as f64; }
      println!("   leaf rms {:.4} bias {:+.4} ground rms {:.4} bias {:+.4}", (q[0][0]/q[0][1]).sqrt(), q[0][2]/q[0][1], (q[1][0]/q[1][1]).sqrt(), q[1][2]/q[1][1]);
      let rays=std::env::var("RAYS").map_or(16,|v|v.parse::<usize>().unwrap()); let n=w.pairs.len()*rays; let ri=match rays {16=>2,64=>3,_=>4};
      // time at same rms
      let mut te = f64::NAN; for k in 1..rows.len(){ let (a,b)=(rows[k-1],rows[k]); if rms<=a.1&&rms>=b.1 {let f=(a.1/rms).ln()/(a.1/b.1).ln(); te=(a.0.ln()+f*(b.0/a.0).ln()).exp();} } if rms<rows[4].1 { te=rows[4].0*(rows[4].1/rms).powi(2);} 
      println!("s {s} {:.4}s {:.3} us/seg rms {:.5} bias {:+.5} nodes/seg {:.2} exact {:.3} handed {:.3} agg {:.3} cov {:.3} | per-seg x{:.2} same-rms x{:.1}", r.run.seconds(), r.run.seconds()*1e6/n as f64, rms,bias, r.cost.nodes as f64/n as f64, r.cost.exact_rays as f64/n as f64, r.cost.handed_over as f64/n as f64, r.cost.aggregated as f64/n as f64, reference.coverage(&r.intervals), rows[ri].0/r.run.seconds(), te/r.run.seconds()); }
}
