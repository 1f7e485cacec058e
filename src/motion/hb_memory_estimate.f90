!> Memory of a point, estimated from the sizes of its model alone, before any large allocation.
!> The estimate is the largest sum of arrays that exist at the same time. A point needs its balance (linear part,
!> samples) and, in addition, the most expensive of three: the tangent of the direct attempt, the fallback, the
!> error estimate with its own wider balance. Products with a tangent need a preconditioner, which becomes stronger for a
!> difficult problem; the strongest one is counted as fallback. Small arrays are counted with the next larger ones;
!> tests/cases/test_memory.py compares the estimate with the memory of runs.
module hb_memory_estimate
   use hb_balance, only: largest_dense_tangent
   use hb_basis, only: basis_t, whole_basis
   use hb_coarse_tangent, only: max_memory
   use hb_condensation, only: condensed_half_bandwidth
   use hb_coordinates, only: coordinates_t
   use hb_discretisation, only: discretisation_t
   use hb_error, only: error_t, fail
   use hb_error_estimate, only: finer_samples, wider_orders
   use hb_hysteresis_tangent, only: width
   use hb_hysteretic_law, only: n_path_parts
   use hb_kinds, only: complex_bytes, gib, real_bytes, wp
   use hb_law, only: law_box_t
   use hb_law_coordinates, only: laws_at
   use hb_model_basis, only: coordinates_of, find_basis
   use hb_options, only: options_t
   use hb_preconditioner, only: unit_work
   use hb_solver_types, only: largest_affordable, method, solver_config_t
   use hb_structure, only: structure_t
   use hb_system, only: system_t
   use hb_text, only: to_text
   use hb_torus, only: cheap_size, default_samples, torus_t
   use hb_wide_problem, only: vectors_of_steps
   implicit none
   private
   public :: amount, check_memory, estimate_memory, memory_estimate_t, memory_text, sizes_of, sizes_t

   !> The sizes on which the estimate depends; real numbers, because invalid inputs may exceed any integer.
   type :: sizes_t
      real(wp) :: n_dofs = 0, n_law_dofs = 0, n_coordinates = 0       !! of the structure; with laws; coordinates of laws
      real(wp) :: matrices = 0, factors = 0                           !! numbers of all matrices; of the factors of the interior
      real(wp) :: linear_bandwidth = 0, bandwidth = 0                 !! half: of the condensed stiffness, of a harmonic's tangent
      real(wp) :: n_harmonics = 0
      real(wp) :: n_kinds = 1                                         !! displacement, velocity, reaction
      real(wp) :: n_pairs = 0                                         !! coupled by laws
      real(wp) :: per_sample = 0                                      !! real numbers that laws store
      real(wp) :: answers_per_sample = 0                              !! of laws with memory, for a tangent
      real(wp) :: states = 0                                          !! coordinates times states, of laws with memory
      integer :: largest_dense = 0                                    !! unknowns up to which the tangent is a dense matrix
      real(wp) :: n_stored_dofs = 0
      integer, allocatable :: highest(:), samples(:)                  !! (n_tones)
      integer, allocatable :: stored_samples(:)                       !! of surfaces, size 0: none
      logical :: is_rigid = .false.                                   !! a law needs the reaction
      logical :: has_error_estimate = .false.
      logical :: has_unknown_tones = .false.
      type(solver_config_t) :: solver
   end type sizes_t

   real(wp), parameter :: of_program = 50.0e6_wp                      ! MPI, HDF5 and the program itself, measured
   real(wp), parameter :: fill = 40.0_wp                              ! of sparse factors, for each entry; solids have more
   real(wp), parameter :: copies = 9.0_wp                             ! of a matrix: in the study, and while a point is read

   !> Bytes, by part.
   type :: memory_estimate_t
      real(wp) :: structure = 0                                       !! matrices and interior factors
      real(wp) :: linear = 0                                          !! loads, condensed stiffness, transfer to the interior
      real(wp) :: samples = 0                                         !! on the torus: motions, forces, spectra, derivatives
      real(wp) :: tangent = 0                                         !! of the direct attempt, with the vectors of the solver
      real(wp) :: fallback = 0   !! instead of the tangent, if the direct attempt fails or is difficult
      real(wp) :: error_estimate = 0                                     !! wider balance, in addition to the tangent
      real(wp) :: results = 0                                         !! of a point, surfaces with their balance
   contains
      procedure :: usual => memory_estimate_usual
      procedure :: worst => memory_estimate_worst
   end type memory_estimate_t

contains

   !> Bytes that a point with these sizes needs.
   pure function estimate_memory(s) result(bytes)
      type(sizes_t), intent(in) :: s
      type(memory_estimate_t) :: bytes
      real(wp) :: dense, n, n_wide, of_error_estimate, table
      integer, allocatable :: orders(:)

      n = unknowns(s, s%n_harmonics)
      bytes%structure = copies*real_bytes*s%matrices + complex_bytes*(s%factors + s%n_dofs*(s%n_coordinates + 2))
      bytes%linear = linear_bytes(s, s%n_harmonics, .true.)
      bytes%results = complex_bytes*s%n_harmonics*(2*s%n_stored_dofs + 3*s%n_law_dofs + s%n_dofs)
      if (size(s%stored_samples) > 0) bytes%results = bytes%results + bytes%linear &
         + sample_bytes(s, s%n_harmonics, s%stored_samples, .false.) + 4*real_bytes*s%n_law_dofs*volume(s%stored_samples)
      if (s%n_coordinates <= 0) return
      bytes%samples = sample_bytes(s, s%n_harmonics, s%samples, .true.)
      dense = real_bytes*n*n
      table = real_bytes*(20*n + 6.5_wp*s%solver%n_threads*table_size(s%highest))   ! of products, with the vectors of a solver
      bytes%tangent = dense + table
      if (s%solver%method == method%broyden) bytes%tangent = bytes%tangent + 2*real_bytes*n*s%solver%memory
      if (s%solver%fallback) bytes%fallback = 2*dense + table
      of_error_estimate = dense
      if (from_products(s)) then
         of_error_estimate = products_bytes(s, .false.)
         if (any(s%solver%method == [method%auto, method%krylov])) then
            bytes%tangent = of_error_estimate
            if (.not. affords_tangent(s)) bytes%fallback = 0
            bytes%fallback = max(products_bytes(s, .true.), bytes%fallback + of_error_estimate)
         else if (s%has_error_estimate) then
            bytes%fallback = max(products_bytes(s, .true.), bytes%fallback)
         end if
      end if
      if (.not. s%has_error_estimate) return
      allocate (orders, source=wider_orders(s%highest))
      n_wide = 0.5_wp*(volume(2*orders + 1) + 1)
      bytes%error_estimate = of_error_estimate + 4*real_bytes*unknowns(s, n_wide) + linear_bytes(s, n_wide, size(orders) == 1) &
                          + complex_bytes*s%n_dofs*merge(n_wide, s%n_harmonics, size(orders) == 1) &
                          + sample_bytes(s, n_wide, finer_samples(s%samples, orders, s%is_rigid .or. s%has_unknown_tones), .false.)
      if (size(orders) > 1 .and. from_products(s) .and. .not. s%is_rigid) &
         bytes%error_estimate = bytes%error_estimate + products_bytes(wider(s, orders, n_wide), .false.)
   end function estimate_memory

   !> The sizes of the wider set of the error estimate.
   pure type(sizes_t) function wider(s, orders, n_harmonics)
      type(sizes_t), intent(in) :: s
      integer, intent(in) :: orders(:)                                !! (n_tones)
      real(wp), intent(in) :: n_harmonics

      wider = s
      wider%highest = orders
      wider%n_harmonics = n_harmonics
      wider%samples = finer_samples(s%samples, orders, s%is_rigid .or. s%has_unknown_tones)
      wider%solver%krylov_vectors = vectors_of_steps
   end function wider

   !> Bytes of a point whose direct attempt succeeds.
   pure real(wp) function memory_estimate_usual(self)
      class(memory_estimate_t), intent(in) :: self

      memory_estimate_usual = of_program + self%structure + self%linear + self%samples + self%results + &
                              max(self%tangent, self%error_estimate)
   end function memory_estimate_usual

   !> Bytes of a point that uses everything its settings permit.
   pure real(wp) function memory_estimate_worst(self)
      class(memory_estimate_t), intent(in) :: self

      memory_estimate_worst = max(self%usual(), of_program + self%structure + self%linear + self%samples + self%results + &
                                  self%fallback)
   end function memory_estimate_worst

   !> Fails for sizes that need more than `limit` bytes or overflow; the message names the largest parts and sizes
   !> that would fit.
   subroutine check_memory(s, limit, error)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: limit                                   !! bytes for this process
      type(error_t), allocatable, intent(out) :: error
      type(memory_estimate_t) :: bytes
      character(:), allocatable :: change

      if (max(unknowns(s, s%n_harmonics), table_size(s%highest)) > real(huge(1), wp)) then
         call fail(error, "there would be "//to_text(anint(unknowns(s, s%n_harmonics)))//" unknowns, more than can be counted; "// &
                   "lower the order of the harmonics")
         return
      else if (largest_row(s) > real(huge(1), wp)) then
         call fail(error, "a point would store "//to_text(anint(largest_row(s)))//" values of one kind, more than can be "// &
                   "counted; store fewer &output dofs or samples, or lower the order of the harmonics")
         return
      end if
      bytes = estimate_memory(s)
      if (bytes%worst() <= limit) return
      call find_what_fits(s, limit, change)
      call fail(error, "this point would need "//trim(amount(bytes%worst()))//" of memory, "//trim(amount(limit))// &
                " are available for each process: "//trim(memory_text(bytes))//". "//change)
   end subroutine check_memory

   !> Largest number of values that a point has in one dataset of the result file.
   pure real(wp) function largest_row(s)
      type(sizes_t), intent(in) :: s

      largest_row = 2*s%n_harmonics*max(s%n_stored_dofs, s%n_law_dofs)
      if (size(s%stored_samples) > 0) largest_row = max(largest_row, volume(s%stored_samples)*s%n_law_dofs)
   end function largest_row

   !> The important parts, the largest first: such as `tangent 3.1 GiB, samples 0.4 GiB`.
   pure function memory_text(bytes) result(text)
      type(memory_estimate_t), intent(in) :: bytes
      character(250) :: text
      character(14), parameter :: names(7) = [character(14) :: &
         "structure", "linear part", "samples", "tangent", "fallback", "error estimate", "results"]
      real(wp) :: parts(7)
      integer :: i, k

      parts = [bytes%structure, bytes%linear, bytes%samples, bytes%tangent, bytes%fallback, bytes%error_estimate, &
               bytes%results]
      text = ""
      do k = 1, size(parts)
         i = maxloc(parts, dim=1)
         if (parts(i) < 0.01_wp*bytes%worst() .and. k > 1) exit
         text = trim(text)//", "//trim(names(i))//" "//amount(parts(i))
         parts(i) = -1.0_wp
      end do
      text = text(3:)
   end function memory_text

   !> Finds changes after which the point fits: no fallback, or lower orders with harmonics and samples in proportion.
   subroutine find_what_fits(s, limit, text)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: limit
      character(:), allocatable, intent(out) :: text
      type(sizes_t) :: other
      real(wp) :: share(size(s%highest))

      text = ""
      other = s
      other%solver%fallback = .false.
      if (worst_of(other) <= limit) text = "&solver fallback = .false. ("//trim(amount(worst_of(other)))//"); "
      other = s
      do while (worst_of(other) > limit .and. any(other%highest > 1))
         other%highest = max(min(s%highest, 1), int(0.95_wp*other%highest))
         share = (2*real(other%highest, wp) + 1)/(2*real(s%highest, wp) + 1)
         other%n_harmonics = max(1.0_wp, s%n_harmonics*product(share))
         other%samples = ceiling(share*s%samples)
      end do
      if (worst_of(other) <= limit) text = text//"order "//to_text(maxval(other%highest))//" instead of "// &
         to_text(maxval(s%highest))//" with at most "//to_text(maxval(other%samples))//" samples a tone ("// &
         trim(amount(worst_of(other)))//")"
      if (len(text) == 0) then
         text = "No lower order would fit; take a smaller structure or more memory (&solver memory_limit, in GiB)"
      else
         text = "What would fit: "//text
      end if
   end subroutine find_what_fits

   pure real(wp) function worst_of(s)
      type(sizes_t), intent(in) :: s
      type(memory_estimate_t) :: bytes

      bytes = estimate_memory(s)
      worst_of = bytes%worst()
   end function worst_of

   !> Unknowns of a set of that many harmonics.
   pure real(wp) function unknowns(s, n_harmonics)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: n_harmonics

      unknowns = 2*n_harmonics*s%n_coordinates
   end function unknowns

   !> Whether steps are computed from products with the tangent; the search for unknown tones also needs the tangent
   !> itself.
   pure logical function from_products(s)
      type(sizes_t), intent(in) :: s

      from_products = .not. s%has_unknown_tones .and. &
                      (s%solver%method == method%krylov .or. unknowns(s, s%n_harmonics) > s%largest_dense)
   end function from_products

   !> GMRES with the samples of its products, and the preconditioner: factors of each harmonic alone and of the partial
   !> or strongest coupling in single precision; see hb_gmres, hb_tangent_product and hb_coarse_tangent. Where products with
   !> the strongest one cost too much, the factors of the tangent take their place, see hb_tangent_solver.
   pure real(wp) function products_bytes(s, is_strongest)
      type(sizes_t), intent(in) :: s
      logical, intent(in) :: is_strongest                             !! otherwise of the level that easy problems do not exceed
      real(wp) :: band, easy, factors, n
      integer, allocatable :: samples(:)

      n = unknowns(s, s%n_harmonics)
      band = (s%bandwidth + 1)*2*s%n_harmonics
      factors = min(n, 3*band)*n
      easy = 8.0_wp**3*unit_work                                      ! multiplications, level 3
      if (.not. is_strongest) factors = min(factors, (1.5_wp*easy)**(2.0_wp/3.0_wp))
      if (.not. is_strongest .and. 6*band <= n) factors = min(factors, 3*band*n*(easy/(4*n*band**2))**(2.0_wp/3.0_wp))
      allocate (samples, source=s%samples)
      if (s%states <= 0.0_wp .and. all(s%samples >= 4*real(s%highest, wp) + 1)) &
         samples = min(s%samples, cheap_size(4*s%highest + 1, size(samples)))
      products_bytes = real_bytes*(n*(s%solver%krylov_vectors + 15) + 0.5_wp*min(max_memory, factors) + &
                                   volume(samples)*((s%n_kinds + 4)*s%n_coordinates + s%n_kinds*s%n_pairs) + &
                                   6.5_wp*table_size(s%highest) + 5*s%n_coordinates**2) &
                       + complex_bytes*s%n_harmonics*s%n_coordinates*factor_rows(s%n_coordinates, s%bandwidth)
      if (is_strongest .and. affords_tangent(s)) products_bytes = products_bytes + real_bytes*n**2
   end function products_bytes

   !> Whether the dense tangent is tried where products do not lead to a solution.
   pure logical function affords_tangent(s)
      type(sizes_t), intent(in) :: s

      affords_tangent = unknowns(s, s%n_harmonics) - s%n_coordinates <= largest_affordable
   end function affords_tangent

   !> Condensed stiffness, and factors of the two harmonics that laws need; see hb_dynamic_stiffness and
   !> hb_linear_part.
   pure real(wp) function linear_bytes(s, n_harmonics, of_interior)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: n_harmonics
      logical, intent(in) :: of_interior !! the data for the motion of all degrees of freedom are stored

      associate (l => s%n_coordinates)
         linear_bytes = complex_bytes*(n_harmonics*(merge((s%n_dofs - l)*l, 0.0_wp, of_interior) + 8*l + size(s%highest)) + &
                                       (n_harmonics + 2)*l*factor_rows(l, s%linear_bandwidth))
      end associate
   end function linear_bytes

   !> Rows of the factors of a matrix of order `n`, see hb_block_factors.
   pure real(wp) function factor_rows(n, half_bandwidth)
      real(wp), intent(in) :: n, half_bandwidth

      factor_rows = 3*half_bandwidth + 1
      if (2*factor_rows > n) factor_rows = n
   end function factor_rows

   !> All arrays of a balance on a grid; see hb_transform, hb_sampled_laws and the modules that they use.
   pure real(wp) function sample_bytes(s, n_harmonics, samples, with_answers)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: n_harmonics
      integer, intent(in) :: samples(:)
      logical, intent(in) :: with_answers                             !! to every coefficient, of laws with memory
      real(wp) :: n_slice

      sample_bytes = real_bytes*volume(samples)*(s%n_coordinates*(s%n_kinds + merge(4, 1, s%states > 0.0_wp)) + &
                                                 s%n_kinds*s%n_pairs + s%per_sample + &
                                                 (1 + 2*min(2, size(samples)))*s%solver%n_threads) ! spectra
      if (.not. with_answers .or. s%states <= 0.0_wp) return
      n_slice = volume(samples)/minval(samples)
      sample_bytes = sample_bytes + real_bytes*(s%answers_per_sample*volume(samples) + &
                                                2*n_harmonics*((s%states + 1)*n_slice + maxval(samples)))
   end function sample_bytes

   !> Entries of the table of products, see hb_transform.
   pure real(wp) function table_size(highest)
      integer, intent(in) :: highest(:)

      table_size = product(4*real(highest, wp) + 1)
   end function table_size

   pure real(wp) function volume(samples)
      integer, intent(in) :: samples(:)

      volume = product(real(samples, wp))
   end function volume

   !> Bytes as text, such as 0.25 GiB or 12 MiB.
   pure function amount(bytes) result(text)
      real(wp), intent(in) :: bytes
      character(14) :: text

      if (bytes >= 1.0e6_wp*gib) then
         write (text, "(es8.1, a)") bytes/gib, " GiB"
      else if (bytes >= 0.95_wp*gib) then
         write (text, "(f10.1, a)") bytes/gib, " GiB"
      else
         write (text, "(i10, a)") nint(bytes/gib*1024.0_wp), " MiB"
      end if
      text = adjustl(text)
   end function amount

   !> The sizes of a model; laws from the first one with an error onwards, and a grid with one, do not count.
   !> Neighbours may need all tuples. Scans sparse matrices of the structure once.
   type(sizes_t) function sizes_of(system, discretisation, options) result(self)
      type(system_t), intent(in) :: system
      type(discretisation_t), intent(in) :: discretisation
      type(options_t), intent(in) :: options
      type(basis_t) :: basis
      type(torus_t) :: torus
      type(error_t), allocatable :: error
      type(coordinates_t) :: coordinates
      type(law_box_t), allocatable :: laws(:)                         ! by number of coordinates
      integer :: i, n, span
      logical :: is_odd

      do n = 0, size(system%laws) - 1
         if (.not. (allocated(system%laws(n + 1)%law%dofs) .and. allocated(system%laws(n + 1)%law%shape))) exit
      end do
      torus = discretisation%torus
      if (.not. allocated(torus%n_samples)) torus%n_samples = default_samples(discretisation%harmonics, 1)
      basis = whole_basis(discretisation%harmonics, torus)
      if (allocated(discretisation%torus%n_samples) .and. n == size(system%laws) .and. .not. options%chain%is_on) then
         call find_basis(basis, is_odd, system, discretisation, options, error)
         associate (last => basis%torus%n_samples(size(torus%n_samples)))
            if (basis%torus%is_half) last = last/2
         end associate
      end if
      coordinates = coordinates_of(system, n)
      laws = laws_at(coordinates, system%laws(:n))
      self%n_dofs = system%structure%n_dofs
      self%n_law_dofs = size(coordinates%dofs)
      self%n_coordinates = coordinates%n
      self%n_harmonics = basis%harmonics%n_harmonics
      self%highest = basis%harmonics%highest
      self%samples = basis%torus%n_samples
      self%n_stored_dofs = size(options%output%dofs)
      self%stored_samples = options%output%samples
      self%solver = options%solver
      self%has_error_estimate = options%error_estimate%is_on .and. n > 0
      self%has_unknown_tones = any(system%tones%is_unknown)
      self%largest_dense = largest_dense_tangent(laws)
      call count_matrices(self, system%structure)
      do i = 1, n
         call add_law(self, laws, i)
      end do
      self%n_pairs = min(self%n_pairs, self%n_coordinates**2)
      self%is_rigid = any([(laws(i)%law%is_multiplier, i=1, n)])
      self%n_kinds = 1 + count([any([(laws(i)%law%needs_velocity, i=1, n)]), self%is_rigid])
      if (coordinates%n == 0) return
      self%linear_bandwidth = coordinates%n - 1
      self%bandwidth = coordinates%n - 1
      ! of a model that is rejected anyway
      if (any(coordinates%dofs < 1 .or. coordinates%dofs > system%structure%n_dofs)) return
      self%linear_bandwidth = condensed_half_bandwidth(system%structure, coordinates)
      span = maxval([(maxval(laws(i)%law%dofs) - minval(laws(i)%law%dofs), i=1, n)])
      self%bandwidth = span
      if (self%is_rigid) self%bandwidth = self%linear_bandwidth + 2*span   ! of a neighbour, too
      self%bandwidth = min(self%n_coordinates, max(self%linear_bandwidth, self%bandwidth))
   end function sizes_of

   !> Counts the entries of the matrices, and of the factors of the interior at one frequency, see hb_block_solver.
   subroutine count_matrices(self, structure)
      type(sizes_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      real(wp) :: n_entries
      integer :: bandwidth, i

      self%matrices = self%n_dofs**2
      self%factors = self%n_dofs**2
      if (.not. allocated(structure%sparse)) return
      associate (k => structure%sparse%stiffness)
         n_entries = real(max(k%n_entries(), structure%sparse%damping%n_entries()), wp) + structure%sparse%mass%n_entries()
         bandwidth = maxval([0, (maxval(abs(k%column(k%first(i):k%first(i + 1) - 1) - i)), i=1, structure%n_dofs)])
      end associate
      self%matrices = 3*n_entries
      self%factors = 6*n_entries + min(fill*n_entries, self%n_dofs*factor_rows(self%n_dofs, real(bandwidth, wp)))
   end subroutine count_matrices

   !> Adds the storage of law i, see hb_sampled_law, hb_slider_states and hb_hysteresis_tangent.
   subroutine add_law(self, laws, i)
      type(sizes_t), intent(inout) :: self
      type(law_box_t), intent(in) :: laws(:)
      integer, intent(in) :: i
      real(wp) :: c, d, n                                             ! coordinates, degrees of freedom; states or kinds
      integer :: k, m

      associate (law => laws(i)%law)
         c = size(law%shape, 2)
         d = size(law%shape, 1)
         n = law%n_states
         if (law%n_states > 0) then
            self%per_sample = self%per_sample + (n_path_parts*c + n)*(n + 1) + c
            self%answers_per_sample = self%answers_per_sample + c*c + c*n + 2*width*c
            self%states = self%states + c*n
            return
         end if
         n = 1 + count([law%needs_velocity, law%is_multiplier])
         self%per_sample = self%per_sample + n*(c*c + merge(0.0_wp, 2*c, size(law%shape) == 1))
         self%n_pairs = self%n_pairs + d*d
         if (.not. law%is_multiplier) return
         do k = 1, size(laws)                                          ! it depends on the forces of its neighbours
            if (k /= i .and. any([(any(law%dofs == laws(k)%law%dofs(m)), m=1, size(laws(k)%law%dofs))])) &
               self%n_pairs = self%n_pairs + d*size(laws(k)%law%dofs)
         end do
      end associate
   end subroutine add_law
end module hb_memory_estimate
