!> The rungs of a benchmark: which order, method, number of samples and further input values each of them takes.
!>
!> The component initialisers are the defaults of the group `&benchmark`; docs/user/input.md lists the keys.
module hb_benchmark_plan
   use hb_error, only: annotate, error_t
   use hb_harmonics, only: harmonics_t
   use hb_kinds, only: wp
   use hb_namelist, only: document_t, group_t
   use hb_scene_tones, only: read_tones
   use hb_solver_types, only: method_names
   use hb_sweep_plan, only: read_sweep_plan, sweep_plan_t
   use hb_text, only: quote, string_t, to_text
   use hb_tones, only: tones_t
   use hb_torus, only: fast_size
   use hb_truncation, only: read_harmonics
   implicit none
   private
   public :: benchmark_plan_t, compare_names, read_benchmark_plan, rung_t

   character(9), parameter :: compare_names(2) = [character(9) :: "union", "reference"]

   !> What one rung takes of each list; 0: the list is empty, the input holds.
   type :: rung_t
      integer :: formulation = 1                                      !! point of the sweep
      integer :: method = 0
      integer :: order = 0
      integer :: sampling = 0
   end type rung_t

   type :: benchmark_plan_t
      type(sweep_plan_t) :: formulations                              !! groups `&sweep`
      integer, allocatable :: orders(:)                               !! size 0: that of the input; so the next four
      integer, allocatable :: samples(:)                              !! per tone, the same for each
      real(wp), allocatable :: oversampling(:)                        !! samples over 2N + 1
      type(string_t), allocatable :: methods(:)
      type(string_t), allocatable :: dofs(:)                          !! where the error is measured; size 0: those of the laws
      integer :: repeats = 3
      character(:), allocatable :: reference_file                     !! not allocated: none
      integer :: reference_point = -1                                 !! of that file, from 0; -1: its only one
      integer :: reference_order = -1                                 !! of a solution beside the rungs; -1: none
      integer :: reference_samples = 0                                !! of that solution; 0: as the last rung
      logical :: compares_union = .true.                              !! tuples that the reference lacks count as zero there
      integer :: n_rungs = 1
   contains
      procedure :: rung => benchmark_plan_rung
      procedure :: apply => benchmark_plan_apply
      procedure :: apply_reference => benchmark_plan_apply_reference
      procedure :: describe => benchmark_plan_describe
      procedure :: describe_sampling => benchmark_plan_describe_sampling
   end type benchmark_plan_t

contains

   !> Reads `&benchmark` and the groups `&sweep` of a document.
   subroutine read_benchmark_plan(self, document, error)
      type(benchmark_plan_t), intent(out) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error

      call read_sweep_plan(self%formulations, document, error)
      if (.not. allocated(error)) call read_benchmark(self, document, error)
      if (allocated(error)) return
      self%n_rungs = self%formulations%n_points*max(1, size(self%methods))*max(1, size(self%orders))*n_samplings(self)
   end subroutine read_benchmark_plan

   subroutine read_benchmark(self, document, error)
      type(benchmark_plan_t), intent(inout) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(group_t), pointer :: group
      character(:), allocatable :: compare

      call document%required_group("benchmark", group, error)
      if (allocated(error)) return
      call group%get("orders", self%orders, minimum=0)
      call group%get("samples", self%samples, minimum=1)
      call group%get("oversampling", self%oversampling, minimum=1.0_wp)
      if (group%given("samples") .and. group%given("oversampling")) &
         call group%problem("oversampling", "give either 'samples' or 'oversampling', not both")
      call group%get("methods", self%methods, choices=method_names)
      call group%get("dofs", self%dofs)
      call group%get("repeats", self%repeats, minimum=1, maximum=1000)
      call group%get("reference_file", self%reference_file)
      call group%get("reference_point", self%reference_point, minimum=0)
      call group%get("reference_order", self%reference_order, minimum=0)
      call group%get("reference_samples", self%reference_samples, minimum=1)
      if (count([allocated(self%reference_file), document%count("reference") > 0, self%reference_order >= 0]) > 1) &
         call group%problem_as_is(group%place()//": give one reference: 'reference_file', 'reference_order' or groups &reference")
      if (group%given("reference_point") .and. .not. group%given("reference_file")) &
         call group%problem("reference_point", "is a point of 'reference_file', which is not given")
      if (group%given("reference_samples") .and. .not. group%given("reference_order")) &
         call group%problem("reference_samples", "belongs to 'reference_order', which is not given")
      compare = trim(compare_names(merge(2, 1, document%count("reference") > 0)))
      call group%get("compare", compare, choices=compare_names)
      self%compares_union = compare == compare_names(1)
      if (.not. allocated(self%orders)) allocate (self%orders(0))
      if (.not. allocated(self%samples)) allocate (self%samples(0))
      if (.not. allocated(self%oversampling)) allocate (self%oversampling(0))
      if (.not. allocated(self%methods)) allocate (self%methods(0))
      if (.not. allocated(self%dofs)) allocate (self%dofs(0))
      call group%finish(error)
   end subroutine read_benchmark

   pure integer function n_samplings(self)
      type(benchmark_plan_t), intent(in) :: self

      n_samplings = max(1, size(self%samples), size(self%oversampling))
   end function n_samplings

   !> What rung i takes; samples change fastest, then orders, then methods.
   function benchmark_plan_rung(self, i) result(rung)
      class(benchmark_plan_t), intent(in) :: self
      integer, intent(in) :: i                                        !! 1 to n_rungs
      type(rung_t) :: rung
      integer :: rest

      rest = i - 1
      call take(max(size(self%samples), size(self%oversampling)), rung%sampling)
      call take(size(self%orders), rung%order)
      call take(size(self%methods), rung%method)
      rung%formulation = 1 + rest

   contains

      !> Takes the last digit of the rest, in a list of this length, from 1; 0 for an empty list.
      subroutine take(length, digit)
         integer, intent(in) :: length
         integer, intent(out) :: digit

         digit = min(length, 1 + modulo(rest, max(1, length)))
         rest = rest/max(1, length)
      end subroutine take
   end function benchmark_plan_rung

   !> Sets the values of rung i in a document.
   subroutine benchmark_plan_apply(self, i, document, error)
      class(benchmark_plan_t), intent(in) :: self
      integer, intent(in) :: i                                        !! 1 to n_rungs
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(rung_t) :: rung

      rung = self%rung(i)
      call self%formulations%apply(rung%formulation, document, error)
      if (rung%order > 0 .and. .not. allocated(error)) &
         call document%set("harmonics%order", to_text(self%orders(rung%order)), error)
      if (rung%method > 0 .and. .not. allocated(error)) &
         call document%set("solver%method", quote(self%methods(rung%method)%value), error)
      if (rung%sampling == 0 .or. allocated(error)) return
      if (size(self%samples) > 0) then
         call document%set("sampling%samples", to_text(self%samples(rung%sampling)), error)
      else
         call set_oversampling(document, self%oversampling(rung%sampling), error)
      end if
   end subroutine benchmark_plan_apply

   !> Sets the values of the last rung, with the order and samples of the reference.
   subroutine benchmark_plan_apply_reference(self, document, error)
      class(benchmark_plan_t), intent(in) :: self
      type(document_t), intent(inout), target :: document
      type(error_t), allocatable, intent(out) :: error
      type(rung_t) :: last

      last = self%rung(self%n_rungs)
      call self%formulations%apply(last%formulation, document, error)
      if (.not. allocated(error)) call document%set("harmonics%order", to_text(self%reference_order), error)
      if (allocated(error)) return
      if (self%reference_samples > 0) then
         call document%set("sampling%samples", to_text(self%reference_samples), error)
      else if (size(self%oversampling) > 0) then
         call set_oversampling(document, self%oversampling(last%sampling), error)
      else if (size(self%samples) > 0) then
         call document%set("sampling%samples", to_text(self%samples(last%sampling)), error)
      end if
   end subroutine benchmark_plan_apply_reference

   !> Sets the samples of each tone to a multiple of the 2N + 1 that its order N needs, rounded up to a fast size.
   subroutine set_oversampling(document, oversampling, error)
      type(document_t), intent(inout) :: document
      real(wp), intent(in) :: oversampling                            !! >= 1
      type(error_t), allocatable, intent(out) :: error
      type(document_t), target :: trial
      type(tones_t) :: tones
      type(harmonics_t) :: harmonics
      character(:), allocatable :: list
      integer :: m

      trial = document
      call read_tones(tones, trial, error)
      if (.not. allocated(error)) call read_harmonics(harmonics, trial, tones%n_tones, error)
      if (allocated(error)) return
      list = ""
      do m = 1, tones%n_tones
         if (m > 1) list = list//", "
         list = list//to_text(fast_size(ceiling(oversampling*(2*harmonics%highest(m) + 1))))
      end do
      call document%set("sampling%samples", list, error)
      call annotate(error, "&benchmark: oversampling")
   end subroutine set_oversampling

   !> Text such as `order 7, newton, law(1)%gap = 0.0015`, for messages.
   function benchmark_plan_describe(self, i) result(text)
      class(benchmark_plan_t), intent(in) :: self
      integer, intent(in) :: i                                        !! 1 to n_rungs
      character(:), allocatable :: text
      type(rung_t) :: rung

      rung = self%rung(i)
      text = "rung "//to_text(i - 1)
      if (rung%order > 0) text = text//", order "//to_text(self%orders(rung%order))
      if (rung%method > 0) text = text//", "//self%methods(rung%method)%value
      if (rung%sampling > 0) text = text//", "//self%describe_sampling(i)
      if (size(self%formulations%parameters) > 0) text = text//", "//self%formulations%describe(rung%formulation)
   end function benchmark_plan_describe

   !> Text such as `64 samples` or `oversampling 3.0`; empty where the input decides.
   function benchmark_plan_describe_sampling(self, i) result(text)
      class(benchmark_plan_t), intent(in) :: self
      integer, intent(in) :: i                                        !! 1 to n_rungs
      character(:), allocatable :: text
      type(rung_t) :: rung

      rung = self%rung(i)
      text = ""
      if (rung%sampling == 0) return
      if (size(self%samples) > 0) then
         text = to_text(self%samples(rung%sampling))//" samples"
      else
         text = "oversampling "//to_text(self%oversampling(rung%sampling))
      end if
   end function benchmark_plan_describe_sampling
end module hb_benchmark_plan
