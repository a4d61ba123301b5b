//! What compilers of some platforms cannot do: nothing of it may occur in a shader.
//!
//! Direct3D's old compiler, FXC, unrolls a loop that writes a vector at a run-time index, or gives up. And an array in
//! a function has a layout in SPIR-V that naga writes and Vulkan forbids.

use super::tests::{SHADERS, validated};
use naga::back::PipelineConstants;
use naga::back::pipeline_constants::process_overrides;
use naga::valid::{FunctionInfo, ModuleInfo};
use naga::{Block, Expression, Function, Handle, Module, Statement, TypeInner};

/// All statements of a block and of the blocks in it.
fn statements<'a>(block: &'a Block, found: &mut Vec<&'a Statement>) {
    for statement in block {
        found.push(statement);
        match statement {
            Statement::Block(inner) => statements(inner, found),
            Statement::If { accept: first, reject: second, .. }
            | Statement::Loop { body: first, continuing: second, .. } => {
                statements(first, found);
                statements(second, found);
            }
            Statement::Switch { cases, .. } => cases.iter().for_each(|case| statements(&case.body, found)),
            _ => {}
        }
    }
}

/// Whether an expression is a vector, or a pointer to one.
fn is_vector(module: &Module, info: &FunctionInfo, expression: Handle<Expression>) -> bool {
    match info[expression].ty.inner_with(&module.types) {
        TypeInner::Pointer { base, .. } => matches!(module.types[*base].inner, TypeInner::Vector { .. }),
        TypeInner::ValuePointer { size, .. } => size.is_some(),
        inner => matches!(inner, TypeInner::Vector { .. }),
    }
}

/// Whether a pointer is to a component of a vector that only the running shader knows.
fn is_indexed_vector(
    module: &Module,
    info: &FunctionInfo,
    function: &Function,
    pointer: Handle<Expression>,
) -> bool {
    match function.expressions[pointer] {
        Expression::Access { base, .. } => {
            is_vector(module, info, base) || is_indexed_vector(module, info, function, base)
        }
        Expression::AccessIndex { base, .. } => is_indexed_vector(module, info, function, base),
        _ => false,
    }
}

fn writes_vector_at_index(module: &Module, info: &FunctionInfo, function: &Function) -> bool {
    let mut all = Vec::new();
    statements(&function.body, &mut all);
    all.iter().any(|statement| {
        matches!(statement, Statement::Store { pointer, .. } if is_indexed_vector(module, info, function, *pointer))
    })
}

/// Whether a function has an array of its own: a variable, or a value that is indexed.
fn has_array(module: &Module, info: &FunctionInfo, function: &Function) -> bool {
    let is_array = |inner: &TypeInner| matches!(inner, TypeInner::Array { .. });
    let mut variables = function.local_variables.iter();
    variables.any(|(_, variable)| is_array(&module.types[variable.ty].inner))
        || function.expressions.iter().any(|(_, expression)| match expression {
            Expression::Access { base, .. } => is_array(info[*base].ty.inner_with(&module.types)),
            _ => false,
        })
}

type Fault = fn(&Module, &FunctionInfo, &Function) -> bool;

fn faulty(module: &Module, info: &ModuleInfo, fault: Fault) -> Vec<String> {
    let entries = module.entry_points.iter().enumerate();
    let entries = entries.map(|(i, entry)| (&entry.function, info.get_entry_point(i), entry.name.clone()));
    let functions = module.functions.iter();
    let functions = functions
        .map(|(handle, function)| (function, &info[handle], function.name.clone().unwrap_or_default()));
    let all = functions.chain(entries);
    all.filter(|(function, info, _)| fault(module, info, function)).map(|(.., name)| name).collect()
}

/// Fails with the names of all functions of all variants of shaders that have a fault.
fn assert_none(what: &str, fault: Fault) {
    let mut found = Vec::new();
    for shader in &SHADERS {
        let (module, info) = validated(shader);
        for channels in 1..=4 {
            let constants = shader.constants(channels).into_iter();
            let constants: PipelineConstants =
                constants.map(|(name, value)| (name.to_owned(), value)).collect();
            let (module, info) = process_overrides(&module, &info, None, &constants).unwrap();
            let names = faulty(&module, &info, fault);
            found.extend(names.into_iter().map(|name| format!("{}: {name}", shader.name)));
        }
    }
    found.dedup();
    assert!(found.is_empty(), "{what}: {}", found.join(", "));
}

#[test]
fn no_shader_writes_a_vector_at_a_run_time_index() {
    assert_none("writes a vector at a run-time index", writes_vector_at_index);
}

#[test]
fn no_shader_has_an_array_in_a_function() {
    assert_none("has an array in a function", has_array);
}
