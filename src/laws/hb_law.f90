!> A nonlinear law: forces as a function of the motion, sample by sample on the torus.
!>
!> A law acts on coordinates z = shape^T q, linear functionals of a few degrees of freedom q; its force f on the
!> coordinates is added to K q on the left-hand side, as shape f. A law declares its numbers and options once (hb_numbers);
!> all else that follows from them is set by `derive`. A law from numbers is a structure constructor and `new_law`:
!>
!>     call new_law(box, elastic_stop_t(stiffness=1.0e5_wp, gap=1.0e-3_wp), "stop", [dof], error)
!>
!> To add a law: a module that extends `law_t`, a row in the table of laws, rows in the table of input keys. Source:
!> docs/why/theory.md, section 5.
module hb_law
   use hb_error, only: annotate, error_t, fail
   use hb_kinds, only: wp
   use hb_numbers, only: number_t, numbered_t, numbers_t
   use hb_problems, only: problem_list_t, problems_t
   use hb_text, only: max_name
   implicit none
   private
   public :: add_coordinate, defects_t, has_memory, hold_t, kink_t, law_box_t, law_t, new_law, place_on_dofs, placement_t

   !> Largest defects over the samples.
   type :: defects_t
      real(wp) :: penetration = 0.0_wp                                !! into an obstacle [m]
      real(wp) :: tension = 0.0_wp                                    !! tensile force of an obstacle that can only push [N]
      real(wp) :: complementarity = 0.0_wp                            !! reaction of an obstacle times its distance [N m]
      real(wp) :: slip = 0.0_wp                                       !! power of exact friction beyond that of the reaction [W]
   end type defects_t

   !> Constraint of the coordinate of a rigid law in time integration: at a wall, or while friction sticks.
   type :: hold_t
      integer :: coordinate = 0                                       !! index among all laws, set by the integrator
      logical :: is_wall = .false.                                    !! otherwise friction
      real(wp) :: gap = 0.0_wp                                        !! of the wall [m]
      logical :: two_sided = .false.
      real(wp) :: restitution = -1.0_wp !! ratio of the speeds after and before an impact; < 0: not given
      real(wp) :: limit = 0.0_wp                                      !! of friction [N]
      character(:), allocatable :: failure !! why no integrator supports it, and a remedy; not allocated if one does
   end type hold_t

   !> Kinks of the force along one combination z = form . coordinates: the force is smooth except for the sum over k
   !> of jumps(k) max(z - positions(k), 0) in `direction`.
   type :: kink_t
      real(wp), allocatable :: functional(:), direction(:)            !! (n_coordinates)
      real(wp), allocatable :: positions(:)                           !! [m], (any)
      real(wp), allocatable :: jumps(:)                               !! of the slope as z rises [N/m], as positions
   end type kink_t

   !> How a law is placed on degrees of freedom.
   type :: placement_t
      logical :: is_by_dofs = .false.                                 !! each of `dofs` is a coordinate; otherwise one linear
                                                                      !! functional of some, or more with `further` ones
      integer :: counts(2) = 0                                        !! permitted numbers of `dofs`; 0: any
      character(64) :: dofs = ""                                      !! which they are, for a message about other numbers
      character(11) :: further(2) = ""                                !! keys of further coordinates, such as "second_dofs"
   end type placement_t

   !> Weights of a coordinate, which are numbers of the law.
   type :: weights_t
      character(max_name) :: key = ""
      real(wp), allocatable :: values(:)
      integer, allocatable :: rows(:)                                 !! in the column of `shape`
      integer :: column = 1
   end type weights_t

   type, extends(numbered_t), abstract :: law_t
      character(:), allocatable :: label                              !! name given by the user, otherwise kind and number
      integer, allocatable :: dofs(:)                                 !! degrees of freedom of the structure
      real(wp), allocatable :: shape(:, :)                            !! (n_dofs, n_coordinates)
      type(weights_t), allocatable, private :: weights(:)             ! of coordinates that have any
      integer, allocatable :: positions(:, :)                         !! (n_dofs, n_places): `dofs` of all laws that a law on
                                                                      !! sets of nodes represents; not allocated: of this one
                                                                      !! only
      integer :: degree = 0                                           !! of a polynomial law; 0: not a polynomial
      logical :: needs_velocity = .false.
      logical :: needs_displacement = .true.                          !! false: a shift of the motion leaves the force as it is
      logical :: is_multiplier = .false.                              !! needs the reaction p; columns of shape are orthogonal
      integer :: n_states = 0                                         !! internal states per sample, for a law with memory
      logical :: is_users_own = .false.                               !! defined by the user; may be undefined far from the motion
      integer :: n_phases = 0                                         !! number of tones whose phases it needs
      integer, allocatable :: modulation(:)                           !! tuples by which it shifts those of a motion, if known,
                                                                      !! each with `n_phases` entries, one after another
      logical :: needs_frequencies = .false.                          !! its force depends explicitly on the base frequencies
      real(wp) :: length_scale = 0.0_wp                               !! a length [m] typical of the law, such as its gap; 0: none
      integer :: n_switches = 0       !! functions of the motion at whose zeros the force has a kink, such as the distance to a stop
      logical :: is_piecewise_linear = .false.                        !! slopes change only at switches and with sliders
      type(kink_t), allocatable :: kinks(:)                           !! between samples; not allocated: none known
      logical :: has_potential = .false.  !! the force at rest is a gradient; additional forces in motion store no energy
      logical :: has_convex_free_region = .false. !! between two motions without force lie others without force; false: not known
      logical :: is_odd = .false.     !! f(-z, -v, -p) = -f(z, v, p), with memory for the mirrored history; false: not known
   contains
      procedure(evaluate_law), deferred :: evaluate
      procedure :: check => law_check
      procedure :: placement => law_placement
      procedure :: shape_on_dofs => law_shape_on_dofs
      procedure :: prepare => law_prepare
      procedure :: prepare_rate => law_prepare_rate
      procedure :: set_phases => law_set_phases
      procedure :: set_frequencies => law_set_frequencies
      procedure :: frequency_slope => law_frequency_slope
      procedure :: number_slope => law_number_slope
      procedure :: declare_inherited => law_declare_inherited
      procedure :: derive_inherited => law_derive_inherited
      procedure :: has_weight => law_has_weight
      procedure :: is_rigid_friction => law_is_rigid_friction
      procedure :: correct => law_correct
      procedure :: defects => law_defects
      procedure :: potential => law_potential
      procedure :: explain => law_explain
      procedure :: fingerprint => law_fingerprint
      procedure :: has_touched_inputs => law_has_touched_inputs
      procedure :: hold => law_hold
      procedure :: switches => law_switches
      procedure :: set_kinks_of_coordinate => law_set_kinks_of_coordinate
      procedure :: evaluate_held => law_evaluate_held
   end type law_t

   !> Container for a law of any kind, so that laws of several kinds form an array.
   type :: law_box_t
      class(law_t), allocatable :: law
   end type law_box_t

   abstract interface
      !> Forces of all samples, and their derivatives when these are present.
      subroutine evaluate_law(self, z, v, p, f, df_dz, df_dv, df_dp)
         import :: law_t, wp
         class(law_t), intent(in) :: self
         real(wp), intent(in), contiguous :: z(:, :)                  !! coordinates [m], (n_samples, n_coordinates)
         real(wp), intent(in), contiguous :: v(:, :)                  !! their rates [m/s]; no columns unless needs_velocity
         real(wp), intent(in), contiguous :: p(:, :)                  !! reaction [N] that equilibrium requires of this law;
                                                                      !! no columns unless is_multiplier
         real(wp), intent(out), contiguous :: f(:, :)                 !! forces [N], as z
         real(wp), intent(out), contiguous, optional :: df_dz(:, :, :)   !! last axis: the coordinate differentiated by
         real(wp), intent(out), contiguous, optional :: df_dv(:, :, :)
         real(wp), intent(out), contiguous, optional :: df_dp(:, :, :)
      end subroutine evaluate_law
   end interface

contains

   !> Creates a law from one with its numbers, on degrees of freedom of a structure, each a coordinate of its own. Fails if
   !> the numbers do not fit together, or if the law needs other degrees of freedom.
   subroutine new_law(self, law, label, dofs, error)
      type(law_box_t), intent(out) :: self
      class(law_t), intent(in) :: law
      character(*), intent(in) :: label                               !! for messages
      integer, intent(in) :: dofs(:)
      type(error_t), allocatable, intent(out) :: error
      type(placement_t) :: placement
      type(problem_list_t) :: problems

      allocate (self%law, source=law)
      self%law%label = label
      placement = law%placement()
      if (all(placement%counts /= size(dofs) .and. placement%counts > 0)) then
         call fail(error, label//": "//trim(placement%dofs))
         return
      end if
      call place_on_dofs(self%law, dofs)
      call self%law%derive()
      call self%law%check(problems)
      if (allocated(problems%error)) call move_alloc(problems%error, error)
      call annotate(error, label)
   end subroutine new_law

   !> Reports numbers and options, each of which is in its range, that do not fit together; without an override all do.
   subroutine law_check(self, problems)
      class(law_t), intent(in) :: self                                !! after `derive`
      class(problems_t), intent(inout) :: problems
   end subroutine law_check

   !> How the law is placed; most laws act on one linear functional.
   pure function law_placement(self) result(placement)
      class(law_t), intent(in) :: self
      type(placement_t) :: placement

      placement = placement_t()
   end function law_placement

   !> The coordinates of a law on `n` degrees of freedom: each of them, unless an override combines them.
   pure function law_shape_on_dofs(self, n) result(shape)
      class(law_t), intent(in) :: self
      integer, intent(in) :: n
      real(wp), allocatable :: shape(:, :)                            !! (n, n_coordinates)
      integer :: i

      allocate (shape(n, n), source=0.0_wp)
      do i = 1, n
         shape(i, i) = 1.0_wp
      end do
   end function law_shape_on_dofs

   !> Passes the static stiffness [N/m] of the structure at the first coordinate of a law that is a multiplier.
   subroutine law_prepare(self, static_stiffness)
      class(law_t), intent(inout) :: self
      real(wp), intent(in) :: static_stiffness                        !! > 0; dynamic stiffness if the structure can move freely
   end subroutine law_prepare

   !> Passes the impedance [N s/m] of the structure at the first coordinate of the law in the fastest retained
   !> harmonic, and its frequency, to a law that is a multiplier.
   subroutine law_prepare_rate(self, impedance, frequency)
      class(law_t), intent(inout) :: self
      real(wp), intent(in) :: impedance                               !! > 0
      real(wp), intent(in) :: frequency                               !! [rad/s], > 0
   end subroutine law_prepare_rate

   !> Passes the phases of all tones at each sample of the following calls of `evaluate`, omega t along time, to a law
   !> with `n_phases`; they are valid until set again. The phases of samples do not depend on any frequency.
   pure subroutine law_set_phases(self, phases)
      class(law_t), intent(inout) :: self
      real(wp), intent(in) :: phases(:, :)                            !! [rad], (n_tones, n_samples)
   end subroutine law_set_phases

   !> Passes the base frequencies to a law that `needs_frequencies`; they are valid until set again.
   pure subroutine law_set_frequencies(self, omega)
      class(law_t), intent(inout) :: self
      real(wp), intent(in) :: omega(:)                                !! [rad/s], (n_tones)
   end subroutine law_set_frequencies

   !> Derivative of the forces at fixed coordinates by a base frequency, of a law that `needs_frequencies`.
   subroutine law_frequency_slope(self, z, v, tone, slope)
      class(law_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :)            !! as `evaluate` has them
      integer, intent(in) :: tone
      real(wp), intent(out), contiguous :: slope(:, :)                !! [N s], as z

      slope = 0.0_wp
   end subroutine law_frequency_slope

   !> Derivative of the forces by a number of the law at fixed coordinates, rates and reactions, exact where the force is
   !> smooth; `is_known` is false if the law has none, so that differences must take its place.
   subroutine law_number_slope(self, number, z, v, p, slope, is_known)
      class(law_t), intent(in) :: self
      type(number_t), intent(in) :: number                            !! one that the law declares
      real(wp), intent(in), contiguous :: z(:, :), v(:, :), p(:, :)   !! as `evaluate` has them
      real(wp), intent(out), contiguous :: slope(:, :)                !! [N by the unit of the number], as z
      logical, intent(out) :: is_known

      slope = 0.0_wp
      is_known = .false.
   end subroutine law_number_slope

   subroutine law_declare_inherited(self, numbers)
      class(law_t), intent(inout) :: self
      class(numbers_t), intent(inout) :: numbers
      integer :: i

      if (.not. allocated(self%weights)) return
      do i = 1, size(self%weights)
         call numbers%add(trim(self%weights(i)%key), self%weights(i)%values)
      end do
   end subroutine law_declare_inherited

   pure subroutine law_derive_inherited(self)
      class(law_t), intent(inout) :: self
      integer :: i

      do i = 1, size(self%weights)
         associate (weights => self%weights(i))
            self%shape(weights%rows, weights%column) = weights%values
         end associate
      end do
   end subroutine law_derive_inherited

   !> Whether a number is a weight of a coordinate.
   pure logical function law_has_weight(self, number) result(has)
      class(law_t), intent(in) :: self
      type(number_t), intent(in) :: number

      has = .false.
      if (allocated(self%weights)) has = any(self%weights%key == number%key)
   end function law_has_weight

   !> Whether the law is friction without a spring. Errors under it fall with the first power of the order alone.
   pure logical function law_is_rigid_friction(self) result(is_rigid_friction)
      class(law_t), intent(in) :: self

      is_rigid_friction = self%is_multiplier .and. self%needs_velocity
   end function law_is_rigid_friction

   !> Coordinates that satisfy the constraint of the law: the motion moved onto a wall. Other laws leave it unchanged.
   pure subroutine law_correct(self, z, corrected)
      class(law_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :)                                 !! [m], (n_samples, n_coordinates)
      real(wp), intent(out) :: corrected(:, :)                        !! [m], as z

      corrected = z
   end subroutine law_correct

   !> Defects of a motion and its reaction in the conditions of rigid contact or friction; zero for laws without any.
   pure function law_defects(self, z, v, p) result(defects)
      class(law_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :)                                 !! [m], (n_samples, n_coordinates)
      real(wp), intent(in) :: v(:, :)                                 !! their rates [m/s]; no columns unless needs_velocity
      real(wp), intent(in) :: p(:, :)                                 !! reaction [N], as z
      type(defects_t) :: defects

      defects = defects_t()
   end function law_defects

   !> The potential of a law that has one, and its gradient, the force at rest; zero by default.
   subroutine law_potential(self, z, energy, gradient)
      class(law_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :)                     !! [m], (n_samples, n_coordinates)
      real(wp), intent(out) :: energy(:)                              !! [J], (n_samples)
      real(wp), intent(out) :: gradient(:, :)                         !! [N], as z

      energy = 0.0_wp
      gradient = 0.0_wp
   end subroutine law_potential

   !> Explains why forces or derivatives at these samples are not finite; empty if the law has no explanation.
   subroutine law_explain(self, z, v, text, is_fatal)
      class(law_t), intent(in) :: self
      real(wp), intent(in), contiguous :: z(:, :), v(:, :)            !! as `evaluate` had them
      character(:), allocatable, intent(out) :: text
      logical, intent(out) :: is_fatal                                !! other samples will not help: the point has failed

      text = ""
      is_fatal = .false.
   end subroutine law_explain

   !> Fingerprint of external code: its name and a checksum; empty for laws of nhbm.
   function law_fingerprint(self) result(text)
      class(law_t), intent(in) :: self
      character(300) :: text

      text = ""
   end function law_fingerprint

   !> Whether `evaluate` writes to its input arguments, as external code may.
   logical function law_has_touched_inputs(self, z, v) result(has_touched)
      class(law_t), intent(in) :: self
      real(wp), intent(in) :: z(:, :), v(:, :)                        !! as `evaluate` has them

      has_touched = .false.
   end function law_has_touched_inputs

   !> Constraint of a law that needs the reaction in time integration; not supported unless the law overrides this.
   function law_hold(self) result(hold)
      class(law_t), intent(in) :: self
      type(hold_t) :: hold

      hold%failure = "no method of time integration supports law '"//self%label//"', which is rigid"
   end function law_hold

   !> Sets the kinks of a force that depends on one coordinate. Not by an array constructor: gfortran does not deallocate the
   !> components of its elements.
   pure subroutine law_set_kinks_of_coordinate(self, positions, jumps)
      class(law_t), intent(inout) :: self
      real(wp), intent(in) :: positions(:)                            !! [m]
      real(wp), intent(in) :: jumps(:)                                !! of the slope as the coordinate rises [N/m]

      if (allocated(self%kinks)) deallocate (self%kinks)
      allocate (self%kinks(1))
      self%kinks(1)%functional = [1.0_wp]
      self%kinks(1)%direction = [1.0_wp]
      self%kinks(1)%positions = positions
      self%kinks(1)%jumps = jumps
   end subroutine law_set_kinks_of_coordinate

   !> Functions whose zeros are kinks of the force; time integration stops where one of them changes its sign.
   pure subroutine law_switches(self, z, v, values)
      class(law_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)                              !! coordinates [m] and rates [m/s], (n_coordinates)
      real(wp), intent(out) :: values(:)                              !! (n_switches)

      values = 0.0_wp
   end subroutine law_switches

   !> Forces at one moment on the smooth branch of given signs of the switches, whatever their values.
   subroutine law_evaluate_held(self, z, v, is_positive, f)
      class(law_t), intent(in) :: self
      real(wp), intent(in) :: z(:), v(:)                              !! [m], [m/s], (n_coordinates)
      logical, intent(in) :: is_positive(:)                           !! (n_switches)
      real(wp), intent(out) :: f(:)                                   !! [N], (n_coordinates)
      real(wp) :: forces(1, size(z)), no_reaction(1, 0)

      if (self%needs_velocity) then
         call self%evaluate(reshape(z, [1, size(z)]), reshape(v, [1, size(v)]), no_reaction, forces)
      else
         call self%evaluate(reshape(z, [1, size(z)]), no_reaction, no_reaction, forces)
      end if
      f = forces(1, :)
   end subroutine law_evaluate_held

   !> Places the law on several degrees of freedom, each a coordinate of its own unless the law combines them.
   pure subroutine place_on_dofs(self, dofs)
      class(law_t), intent(inout) :: self
      integer, intent(in) :: dofs(:)

      if (allocated(self%weights)) deallocate (self%weights)
      self%dofs = dofs
      self%shape = self%shape_on_dofs(size(dofs))
   end subroutine place_on_dofs

   !> Adds a coordinate of the law, z = sum of weights times degrees of freedom; those of previous coordinates may occur
   !> again. With several columns of `positions` the law stands for as many laws, each at one of them.
   pure subroutine add_coordinate(self, positions, weights, key)
      class(law_t), intent(inout) :: self
      integer, intent(in) :: positions(:, :)                          !! degrees of freedom, (any, n_places); n_places is at least
                                                                      !! that of the law
      real(wp), intent(in) :: weights(:)                              !! (any)
      character(*), intent(in), optional :: key                       !! of the weights, if they are numbers of the law
      integer, allocatable :: all_positions(:, :), row(:)
      real(wp), allocatable :: shape(:, :)
      type(weights_t), allocatable :: all_weights(:)
      integer :: i, k, n, n_before, n_coordinates

      n_coordinates = 1
      n_before = 0
      if (allocated(self%dofs)) then
         n_before = size(self%dofs)
         n_coordinates = size(self%shape, 2) + 1
      end if
      allocate (all_positions(n_before + size(weights), size(positions, 2)), row(size(weights)))
      if (allocated(self%positions)) then
         all_positions(:n_before, :) = self%positions
      else if (n_before > 0) then
         all_positions(:n_before, :) = spread(self%dofs, 2, size(positions, 2))
      end if
      n = n_before
      do i = 1, size(weights)
         row(i) = 0
         do k = 1, n
            if (all(all_positions(k, :) == positions(i, :))) row(i) = k
         end do
         if (row(i) > 0) cycle
         n = n + 1
         row(i) = n
         all_positions(n, :) = positions(i, :)
      end do
      allocate (shape(n, n_coordinates), source=0.0_wp)
      if (n_before > 0) shape(:n_before, :n_coordinates - 1) = self%shape
      do i = 1, size(weights)
         shape(row(i), n_coordinates) = weights(i)
      end do
      self%dofs = all_positions(:n, 1)
      call move_alloc(shape, self%shape)
      if (allocated(self%positions)) deallocate (self%positions)
      if (size(all_positions, 2) > 1) self%positions = all_positions(:n, :)
      if (.not. present(key)) return
      if (.not. allocated(self%weights)) allocate (self%weights(0))
      allocate (all_weights(size(self%weights) + 1))                  ! gfortran 12 leaks components of constructors in a list
      all_weights(:size(self%weights)) = self%weights
      associate (new => all_weights(size(all_weights)))
         new%key = key
         new%values = weights
         new%rows = row
         new%column = n_coordinates
      end associate
      call move_alloc(all_weights, self%weights)
   end subroutine add_coordinate

   !> Whether any of these laws has a memory.
   pure logical function has_memory(laws)
      type(law_box_t), intent(in) :: laws(:)
      integer :: i

      has_memory = any([(laws(i)%law%n_states > 0, i=1, size(laws))])
   end function has_memory
end module hb_law
