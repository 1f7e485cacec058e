!> The arrays that a point allocates, counted by what the procedures of the solver take.
submodule (hb_memory_estimate) hb_memory_of_arrays
   use hb_balance, only: largest_dense_tangent
   use hb_block_factors, only: least_rough
   use hb_coarse_tangent, only: max_memory
   use hb_condensation, only: condensed_half_bandwidth
   use hb_contact_parts, only: is_factorised
   use hb_coordinates, only: coordinates_t
   use hb_hysteresis_tangent, only: block_width
   use hb_hysteretic_law, only: n_path_parts
   use hb_kinds, only: complex_bytes, real_bytes
   use hb_law, only: law_box_t
   use hb_law_coordinates, only: laws_at
   use hb_model_basis, only: find_basis
   use hb_preconditioner, only: unit_work
   use hb_shared_stiffness, only: pays_to_share
   use hb_solver_types, only: largest_affordable, method
   use hb_structure, only: structure_t
   use hb_system, only: coordinates_of
   use hb_torus, only: cheap_size, default_samples, torus_t
   use hb_wide_problem, only: vectors_of_steps
   use hb_wider_discretisation, only: finer_samples, wider_orders
   implicit none

   real(wp), parameter :: fill_of_sparse_factors = 40.0_wp            ! of sparse factors, for each entry; solids have more
   real(wp), parameter :: factors_of_whole = 0.1_wp                    ! real and symmetric, with modes, by those of an interior
   real(wp), parameter :: copies_of_matrix = 9.0_wp                   ! of a matrix: in the study, and while a point is read

contains

   module procedure estimate_memory
      real(wp) :: dense, n, n_wide, of_error_estimate, table
      integer, allocatable :: orders(:)

      n = unknowns(s, s%n_harmonics)
      bytes%structure = copies_of_matrix*real_bytes*s%matrices + complex_bytes*s%factors
      if (.not. s%is_whole) bytes%structure = bytes%structure + complex_bytes*s%n_dofs*(s%n_coordinates + 2)
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
                          + corrected_bytes(s)*merge(n_wide - s%n_harmonics, n_wide, size(orders) == 1) & ! of added harmonics
                          + sample_bytes(s, n_wide, finer_samples(s%samples, orders, s%is_rigid .or. s%has_unknown_tones), .false.)
      if (size(orders) > 1 .and. from_products(s) .and. .not. s%is_rigid) &
         bytes%error_estimate = bytes%error_estimate + products_bytes(wider(s, orders, n_wide), .false.)
   end procedure estimate_memory

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

   module procedure unknowns
      unknowns = 2*n_harmonics*s%n_coordinates
   end procedure unknowns

   module procedure table_size
      table_size = product(4*real(highest, wp) + 1)
   end procedure table_size

   module procedure volume
      volume = product(real(samples, wp))
   end procedure volume

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
      if (s%is_whole) factors = 0.0_wp                                ! stuck contacts precondition
      allocate (samples, source=s%samples)
      if (s%states <= 0.0_wp .and. all(s%samples >= 4*real(s%highest, wp) + 1)) &
         samples = min(s%samples, cheap_size(4*s%highest + 1, size(samples)))
      products_bytes = real_bytes*(n*(s%solver%krylov_vectors + 15) + 0.5_wp*min(max_memory, factors) + &
                                   volume(samples)*((s%n_kinds + 4)*s%n_coordinates + s%n_kinds*s%n_pairs) + &
                                   6.5_wp*table_size(s%highest) + merge(0.0_wp, 5*s%n_coordinates**2, s%is_whole)) &
                       + s%n_harmonics*corrected_bytes(s)
      if (is_strongest .and. affords_tangent(s)) products_bytes = products_bytes + real_bytes*n**2
   end function products_bytes

   !> Factors of the tangent of one harmonic, in single precision where hb_block_factors has them so.
   pure real(wp) function corrected_bytes(s)
      type(sizes_t), intent(in) :: s

      corrected_bytes = 0.0_wp
      if (s%is_whole) return
      associate (rows => factor_rows(s%n_coordinates, s%bandwidth))
         corrected_bytes = complex_bytes*s%n_coordinates*rows
         if (rows >= s%n_coordinates .and. s%n_coordinates >= least_rough) corrected_bytes = 0.5_wp*corrected_bytes
      end associate
   end function corrected_bytes

   !> Whether the dense tangent is tried where products do not lead to a solution.
   pure logical function affords_tangent(s)
      type(sizes_t), intent(in) :: s

      affords_tangent = .not. s%is_whole .and. unknowns(s, s%n_harmonics) - s%n_coordinates <= largest_affordable
   end function affords_tangent

   !> Condensed stiffness, and factors of the two harmonics that laws need; see hb_dynamic_stiffness and
   !> hb_linear_part.
   pure real(wp) function linear_bytes(s, n_harmonics, of_interior)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: n_harmonics
      logical, intent(in) :: of_interior !! the data for the motion of all degrees of freedom are stored

      real(wp), parameter :: columns_per_harmonic = 8.0_wp             ! of all degrees of freedom, for each harmonic
      real(wp) :: of_stiffness

      if (s%is_whole) then
         linear_bytes = real_bytes*columns_per_harmonic*n_harmonics*(s%n_dofs + s%n_coordinates)
         return
      end if
      associate (l => s%n_coordinates, n_interior => s%n_dofs - s%n_coordinates)
         of_stiffness = n_harmonics*l*factor_rows(l, s%linear_bandwidth)
         if (shares_matrices(s, n_harmonics)) of_stiffness = 1.5_wp*l*l + 2*n_harmonics*l*n_interior
         linear_bytes = complex_bytes*(n_harmonics*(merge(n_interior*l, 0.0_wp, of_interior) + 8*l + size(s%highest)) + &
                                       of_stiffness + 2*l*factor_rows(l, s%linear_bandwidth))
      end associate
   end function linear_bytes

   !> Whether all harmonics share the matrices of the condensed stiffness; with an unknown tone it has derivatives, which do not.
   pure logical function shares_matrices(s, n_harmonics)
      type(sizes_t), intent(in) :: s
      real(wp), intent(in) :: n_harmonics

      shares_matrices = .not. (s%has_unknown_tones .or. factor_rows(s%n_coordinates, s%linear_bandwidth) < s%n_coordinates)
      if (shares_matrices) shares_matrices = s%n_dofs <= huge(1)
      if (shares_matrices) shares_matrices = pays_to_share(int(s%n_coordinates), int(s%n_dofs - s%n_coordinates), &
                                                           int(min(n_harmonics, 1.0e3_wp)))
   end function shares_matrices

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

   module procedure sizes_of
      type(discretisation_t) :: basis
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
      basis = discretisation
      basis%torus = torus
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
      call count_matrices(self, system%structure, real(max(0, system%structure%n_dofs - coordinates%n), wp))
      do i = 1, n
         call add_law(self, laws, i)
      end do
      self%n_pairs = min(self%n_pairs, self%n_coordinates**2)
      self%is_rigid = any([(laws(i)%law%is_multiplier, i=1, n)])
      self%n_kinds = 1 + count([any([(laws(i)%law%needs_velocity, i=1, n)]), self%is_rigid])
      if (coordinates%n == 0) return
      if (allocated(system%structure%sparse)) self%is_whole = is_factorised(system%structure, coordinates, laws)
      if (self%is_whole) then
         self%factors = factors_of_whole*self%factors
         self%largest_dense = 0
      end if
      self%linear_bandwidth = coordinates%n - 1
      self%bandwidth = coordinates%n - 1
      ! of a model that is rejected anyway
      if (any(coordinates%dofs < 1 .or. coordinates%dofs > system%structure%n_dofs)) return
      self%linear_bandwidth = 0
      if (.not. self%is_whole) self%linear_bandwidth = condensed_half_bandwidth(system%structure, coordinates)
      span = maxval([(maxval(laws(i)%law%dofs) - minval(laws(i)%law%dofs), i=1, n)])
      self%bandwidth = span
      if (self%is_rigid) self%bandwidth = self%linear_bandwidth + 2*span   ! of a neighbour, too
      self%bandwidth = min(self%n_coordinates, max(self%linear_bandwidth, self%bandwidth))
   end procedure sizes_of

   !> Counts the entries of the matrices, and of the factors of the interior at one frequency, see hb_block_solver.
   subroutine count_matrices(self, structure, n_interior)
      type(sizes_t), intent(inout) :: self
      type(structure_t), intent(in) :: structure
      real(wp), intent(in) :: n_interior                              !! degrees of freedom
      real(wp) :: n_entries
      integer :: bandwidth, i

      self%matrices = self%n_dofs**2
      self%factors = self%n_dofs**2
      if (.not. allocated(structure%sparse)) return
      associate (k => structure%sparse%stiffness)
         n_entries = real(max(k%n_entries(), structure%sparse%damping%n_entries()), wp) + structure%sparse%mass%n_entries()
         bandwidth = maxval([0, (maxval(abs(k%column(k%first(i):k%first(i + 1) - 1) - i)), i=1, structure%n_dofs)])
      end associate
      self%matrices = n_entries                                       ! with those of damping and the numbers of columns
      n_entries = min(n_entries, n_interior**2)
      self%factors = 6*n_entries + min(fill_of_sparse_factors*n_entries, n_interior*factor_rows(n_interior, real(bandwidth, wp)))
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
            self%answers_per_sample = self%answers_per_sample + c*c + c*n + 4*block_width*c
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

end submodule hb_memory_of_arrays
